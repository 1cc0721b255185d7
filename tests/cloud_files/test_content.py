"""Files that a general program has compressed, read as they are."""

import bz2
import gzip
import lzma
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from cloud_files import content
from cloud_files.content import limit_of, plain_suffix, read_content, unpacked
from pointkit.coding import zstandard
from pointkit.errors import InputError
from pointkit.files import read_bytes

COMPRESS: dict[str, Callable[[bytes], bytes]] = {
    ".gz": gzip.compress,
    ".bz2": bz2.compress,
    ".xz": lzma.compress,
    ".zst": zstandard.compressed,
}
POINTER = b"version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 12\n"


@pytest.mark.parametrize("suffix", COMPRESS)
def test_content_is_what_was_compressed(suffix: str, tmp_path: Path) -> None:
    data, path = bytes(range(256)) * 9000, tmp_path / f"A.PLY{suffix.upper()}"
    path.write_bytes(COMPRESS[suffix](data))
    assert read_content(path) == data
    assert read_content(path, 300) == data[:300]
    assert plain_suffix(path) == ".ply"
    with unpacked(path) as plain:
        assert plain.name == "A.PLY"
        assert plain.read_bytes() == data
    assert not plain.exists()


def test_other_files_are_read_as_they_are(tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    path.write_bytes(b"12345")
    assert read_content(path) == b"12345"
    assert read_content(path, 3) == b"123"
    assert plain_suffix(path) == ".ply"
    with unpacked(path) as plain:
        assert plain == path


@pytest.mark.parametrize("suffix", COMPRESS)
def test_damaged_content_is_refused(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"a.ply{suffix}"
    whole = COMPRESS[suffix](bytes(range(256)) * 90)
    for data in (whole[:-20], b"no compressed file", whole[:20] + b"\xff" * 40):
        path.write_bytes(data)
        with pytest.raises(InputError, match=rf"a\.ply{suffix}: damaged compressed file"):
            read_content(path)


@pytest.mark.parametrize("suffix", COMPRESS)
def test_content_is_bounded(suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / f"a.xyz{suffix}"
    path.write_bytes(COMPRESS[suffix](bytes(100_000)))
    monkeypatch.setattr(content, "LEAST_LIMIT", 100_000)
    assert len(read_content(path)) == 100_000
    monkeypatch.setattr(content, "LEAST_LIMIT", 99_999)
    with pytest.raises(InputError, match=r"unpacks to more than 99,999 bytes"):
        read_content(path)
    path.write_bytes(COMPRESS[suffix](bytes(range(256)) * 2))
    monkeypatch.setattr(content, "LEAST_LIMIT", 1)
    assert len(read_content(path)) == 512  # less than forty times the file


def test_the_bound_is_256_mib_or_forty_times_the_file(tmp_path: Path) -> None:
    path = tmp_path / "a.xyz.gz"
    path.write_bytes(b"1")
    assert limit_of(path) == 256 * 1024 * 1024
    with path.open("wb") as stream:
        stream.truncate(10_000_000)
    assert limit_of(path) == 400_000_000


def test_a_bomb_takes_no_more_memory_than_its_bound(tmp_path: Path) -> None:
    """2 GiB of zeros in 2 MB, of which a process of 1 GiB reads no more than it may."""
    path = tmp_path / "a.xyz.gz"
    path.write_bytes(32 * gzip.compress(bytes(1 << 26)))  # members of a file
    script = (
        "import resource, sys; from pathlib import Path\n"
        "from cloud_files.content import read_content\n"
        "resource.setrlimit(resource.RLIMIT_AS, (1 << 30, 1 << 30))\n"
        "read_content(Path(sys.argv[1]))"
    )
    done = subprocess.run([sys.executable, "-c", script, path], capture_output=True, check=False)
    assert b"unpacks to more than" in done.stderr


def test_missing_files_and_folders_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"a\.ply\.gz: no such file"):
        read_content(tmp_path / "a.ply.gz")
    with pytest.raises(InputError, match="is a directory"):
        read_content(tmp_path, 3)


def test_pointers_of_git_lfs_are_named(tmp_path: Path) -> None:
    for name in ("a.bin", "a.ply.gz"):
        (tmp_path / name).write_bytes(POINTER)
        with pytest.raises(InputError, match=rf"{name}: a Git-LFS pointer, .*: git lfs pull"):
            read_content(tmp_path / name)
    with pytest.raises(InputError, match=r"a\.bin: a Git-LFS pointer"):
        read_bytes(tmp_path / "a.bin")
    with pytest.raises(InputError, match=r"a\.bin: a Git-LFS pointer"):
        read_content(tmp_path / "a.bin", 10)


def test_errors_name_the_compressed_file(tmp_path: Path) -> None:
    path = tmp_path / "a.las.gz"
    path.write_bytes(gzip.compress(b"1"))
    with pytest.raises(InputError, match=rf"^{path}: odd$"), unpacked(path) as plain:
        raise InputError(f"{plain}: odd")
