"""Every file of a cloud or mesh in the corpus gives the expected points or error."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from cloud_files import read_cloud, read_mesh
from tests.cloud_files import corpus
from tests.support.corpus_case import Case, cases, check

CASES = list(cases(corpus))


def _read(case: Case, path: Path) -> tuple[Any, Any]:
    """Points of a file, and its further columns."""
    if case.reader == "cloud":
        cloud = read_cloud(path, **case.options)
        return cloud.xyz, cloud.fields
    mesh = read_mesh(path, **case.options)
    return mesh.vertices, {"area": mesh.areas().sum()}


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.file)
def test_file_gives_the_expected_points_or_error(
    case: Case, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    check(case, tmp_path, caplog, _read)


def test_names_of_the_corpus_differ() -> None:
    names = [case.file for case in CASES]
    assert len(set(names)) == len(names)
