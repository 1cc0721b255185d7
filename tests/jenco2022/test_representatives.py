"""Which codec represents which of the thesis's."""

from typing import Any

import pytest

from jenco2022.needs import codec_role
from puckbench.codecs.registry import codecs, open_codec

ROLES = {
    "draco": "draco",
    "draco_cli": "draco",
    "gpcc": "gpcc",
    "gpcc_arena": "gpcc_as_run",
    "gpcc_dyadic": "gpcc",
    "gpcc_lossless": "gpcc",
    "pcgcv1": "pcgcv1",
    "pcgcv2": "pcgcv2",
    "tmc13": "gpcc",
}


def test_each_codec_of_the_thesis_is_represented_by_that_codec_alone() -> None:
    roles = {name: codec_role(open_codec(name)) for name in codecs()}
    assert {name: role for name, role in roles.items() if role} == ROLES


@pytest.mark.parametrize("name", ["gpcc", "tmc13"])
def test_truncated_coordinates_are_gpcc_as_the_thesis_ran_it(name: str) -> None:
    changes: dict[str, Any] = {"options": {"rounding": "truncate"}}
    assert codec_role(open_codec(name, changes)) == "gpcc_as_run"
