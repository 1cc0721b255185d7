"""Damaged and structured files of every format end in points or in one line."""

from __future__ import annotations

import resource
from collections.abc import Iterator
from pathlib import Path

import pytest

from cloud_files.clouds import SUFFIXES
from cloud_files.meshes.reading import SUFFIXES as MESHES
from tests.support.file_readers import READERS, outcome
from tests.support.stream_damage import damaged

FILES = 24
ADDRESS_SPACE = 2 << 30


@pytest.fixture(autouse=True)
def limited_memory() -> Iterator[None]:
    """Limit the memory, so that excessive use fails without harm to the machine."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    before = resource.getrlimit(resource.RLIMIT_AS)
    limit = pages * resource.getpagesize() + ADDRESS_SPACE
    resource.setrlimit(resource.RLIMIT_AS, (limit, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_AS, before)


@pytest.mark.parametrize("name", READERS)
def test_damaged_files_end_in_points_or_in_one_line(name: str) -> None:
    """Some of the files of benchmarks/checks/fuzz.py, which reads thousands under limits."""
    reader = READERS[name]
    whole = reader.streams()
    assert [outcome(reader, data) for data in whole] == ["points"] * len(whole)
    for number in range(FILES):
        for data in (damaged(whole, number, name), reader.structured(whole, number)):
            assert outcome(reader, data) in {"points", "error"}, number


def test_every_format_is_damaged() -> None:
    formats = {reader.suffix for reader in READERS.values()}
    assert {*SUFFIXES, *MESHES} - {".e57", ".txt", ".asc"} <= formats
