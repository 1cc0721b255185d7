"""Damaged and structured recordings, settings and weights end in points or in one line."""

from __future__ import annotations

import pytest

from tests.support.file_readers import check_damaged_files
from tests.support.recording_readers import READERS


@pytest.mark.parametrize("name", READERS)
def test_damaged_files_end_in_points_or_in_one_line(name: str) -> None:
    check_damaged_files(name, READERS[name])
