"""Damaged and structured files of every format end in points or in one line."""

from __future__ import annotations

import pytest

from cloud_files.clouds import SUFFIXES
from cloud_files.meshes import SUFFIXES as MESHES
from tests.support.file_readers import READERS, check_damaged_files


@pytest.mark.parametrize("name", READERS)
def test_damaged_files_end_in_points_or_in_one_line(name: str) -> None:
    check_damaged_files(name, READERS[name])


def test_every_format_is_damaged() -> None:
    formats = {reader.suffix for reader in READERS.values()}
    assert {*SUFFIXES, *MESHES} - {".e57", ".txt", ".asc"} <= formats
