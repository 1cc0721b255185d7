import tracemalloc
from pathlib import Path

import pytest

from pointkit.errors import InputError
from puckbench.core.archives import read_archive, read_member, write_archive

MEGABYTE = 1 << 20
NAMES = [f"r{number}.bin" for number in range(20)]


def content(name: str) -> bytes:
    return name.encode().ljust(MEGABYTE, b".")


@pytest.fixture
def archive(tmp_path: Path) -> Path:
    write_archive(tmp_path / "a.zip", {name: content(name) for name in NAMES})
    return tmp_path / "a.zip"


def test_one_member_at_a_time_is_in_memory(archive: Path, tmp_path: Path) -> None:
    tracemalloc.start()
    try:
        write_archive(tmp_path / "b.zip", ((name, content(name)) for name in NAMES))
        assert all(read_member(archive, name) == content(name) for name in NAMES)
        assert tracemalloc.get_traced_memory()[1] < 5 * MEGABYTE
    finally:
        tracemalloc.stop()
    assert (tmp_path / "b.zip").read_bytes() == archive.read_bytes()
    assert read_archive(archive) == {name: content(name) for name in NAMES}


def test_a_member_that_is_missing_or_damaged_is_named(archive: Path) -> None:
    with pytest.raises(InputError, match=r"a\.zip: has no member r20\.bin"):
        read_member(archive, "r20.bin")
    data = archive.read_bytes()
    archive.write_bytes(data.replace(b"r7.bin..", b"r7.bin:.", 1))
    with pytest.raises(InputError, match=r"a\.zip: .*r7\.bin"):
        read_member(archive, "r7.bin")
    archive.write_bytes(data[:-30])
    with pytest.raises(InputError, match=r"a\.zip: not a readable archive"):
        read_member(archive, "r1.bin")
