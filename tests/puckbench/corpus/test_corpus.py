"""Every recording of the corpus gives the expected points or error."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from puckbench.recordings.reading import read_recording, read_turns
from puckbench.scene_sets.recordings import decompressed
from tests.cloud_files import corpus as cloud_corpus
from tests.puckbench import corpus
from tests.support.corpus_case import Case, cases, check

CASES = list(cases(corpus))


def _read(case: Case, path: Path) -> tuple[Any, Any]:
    """Points of a recording, and its further columns."""
    if case.reader == "returns":
        table = read_recording(path, **case.options)
        return table.xyz, table.columns
    with decompressed(path) as recording:
        returns, _, counts, _ = read_turns(recording, **case.options, source=path)
    return returns.points(), counts


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.file)
def test_file_gives_the_expected_points_or_error(
    case: Case, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    check(case, tmp_path, caplog, _read)


def test_names_of_the_corpus_differ() -> None:
    names = [case.file for package in (cloud_corpus, corpus) for case in cases(package)]
    assert len(set(names)) == len(names)
