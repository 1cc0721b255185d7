"""Which runs have the table and the figure of bits against G-PCC's octree."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from puckbench.planning.workflow import Workflow
from tests.support.files import put


@pytest.mark.parametrize(
    ("codecs", "size", "compared"),
    [
        (("gpcc", "gpcc_angular"), "metric", True),
        (("gpcc", "puck"), "metric", True),
        (("gpcc", "reno"), "metric", True),
        (("gpcc", "sparse_octree_net"), "metric", True),
        (("gpcc",), "metric", False),
        (("draco", "puck"), "metric", False),
        (("gpcc", "gpcc_arena"), "metric", False),  # has no rates for clouds in metres
        (("gpcc", "gpcc_angular"), 1024, False),
    ],
)
def test_bits_are_compared_where_another_codec_is_beside_the_octree(
    codecs: tuple[str, ...],
    size: str | int,
    compared: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    put(tmp_path / "data" / "reno_weights" / "KITTIDetection.pt", "")
    spins = {"scene_set": "rooms", "make": "scan", "sweep": {"preset": "spin"}, "size": size}
    config = {
        "scene_sets": {"rooms": {"loader": "embedded_rooms", "select": ["office_1"]}},
        "datasets": {"spins": spins},
        "codecs": {name: {} for name in codecs},
    }
    outputs = Workflow(config).outputs
    assert ("handicap" in outputs.figures) == compared
    assert ("against_octree" in outputs.tables) == compared


def test_scales_of_gpcc_are_drawn_where_it_codes_a_scaled_cloud() -> None:
    config: dict[str, Any] = {
        "thesis": True,
        "scene_sets": {"rooms": {"loader": "embedded_rooms", "select": ["office_1"]}},
        "datasets": {
            "rooms": {"scene_set": "rooms", "make": "sample", "points": 9},
            "metric": {"scene_set": "rooms", "make": "sample", "points": 9, "size": "metric"},
        },
        "codecs": {"draco": {}, "gpcc": {}},
    }
    assert "gpcc_grid" in Workflow(config).outputs.figures
    config["datasets"]["rooms"]["codecs"] = ["draco"]
    assert "gpcc_grid" not in Workflow(config).outputs.figures
