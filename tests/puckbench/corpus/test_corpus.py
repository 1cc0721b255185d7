"""Every file of the corpus gives the expected points or error."""

from __future__ import annotations

import logging
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pointkit.errors import InputError
from tests.puckbench.corpus.case import Case, cases

CASES = list(cases())


def _read(case: Case, path: Path) -> tuple[Any, Any]:
    """Points of a file, and its further columns."""
    if case.reader == "cloud":
        from cloud_files.clouds import read_cloud

        cloud = read_cloud(path, **case.options)
        return cloud.xyz, cloud.fields
    if case.reader == "mesh":
        from cloud_files.meshes import read_mesh

        mesh = read_mesh(path, **case.options)
        return mesh.vertices, {"area": mesh.areas().sum()}
    if case.reader == "returns":
        from puckbench.recordings.reading import read_recording

        table = read_recording(path, **case.options)
        return table.xyz, table.columns
    from puckbench.datasets.recordings import decompressed
    from puckbench.recordings.reading import read_turns

    with decompressed(path) as recording:
        returns, _, counts = read_turns(recording, **case.options, source=path)
    return returns.points(), counts


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.file)
def test_file_gives_the_expected_points_or_error(
    case: Case, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / case.file
    case.write(path)
    with caplog.at_level(logging.WARNING, "puckbench"):
        if case.error is not None:
            with pytest.raises(InputError) as refusal:
                _read(case, path)
            message = str(refusal.value)
            assert re.search(case.error, message), message
            assert "\n" not in message
            return
        points, columns = _read(case, path)
    assert case.points is not None
    np.testing.assert_allclose(points, np.asarray(case.points, dtype=float), rtol=0, atol=1e-9)
    for name, values in case.fields.items():
        np.testing.assert_array_equal(columns[name], values)
    if case.area is not None:
        assert columns["area"] == pytest.approx(case.area, rel=1e-6)
    lines = [record.getMessage() for record in caplog.records]
    if case.warning is None:
        assert not lines
    else:
        assert any(re.search(case.warning, line) for line in lines), lines


def test_names_of_the_corpus_differ() -> None:
    names = [case.file for case in CASES]
    assert len(set(names)) == len(names)
