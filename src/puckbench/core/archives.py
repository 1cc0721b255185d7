"""Archives of results: uncompressed ZIP files, such as the streams of a cloud at all rates."""

from __future__ import annotations

import stat
import struct
import zipfile
from collections.abc import Iterable, Mapping
from io import BytesIO
from pathlib import Path

from pointkit.damage import reading
from pointkit.errors import InputError, naming
from pointkit.files import open_file, read_bytes, written_whole

SUFFIX = ".zip"
_EPOCH = (1980, 1, 1, 0, 0, 0)
"""Earliest time that a ZIP file can store."""
_DAMAGE = (zipfile.BadZipFile, ValueError, RuntimeError, EOFError, OSError, struct.error)
_REGULAR_FILE = 0o100644 << 16


def write_archive(path: Path, members: Mapping[str, bytes] | Iterable[tuple[str, bytes]]) -> None:
    """Write an uncompressed ZIP file.

    The time of writing is not stored, so equal members always give the same bytes.

    Parameters
    ----------
    path
        File to write.
    members
        Content of each member of the archive, by the member's name; or pairs of name and content,
        of which one at a time is held in memory.
    """
    pairs = members.items() if isinstance(members, Mapping) else members
    with written_whole(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        for name, data in pairs:
            member = zipfile.ZipInfo(name, _EPOCH)
            member.external_attr = _REGULAR_FILE
            archive.writestr(member, data)


def read_archive(path: Path) -> dict[str, bytes]:
    """Return the content of each member of a ZIP file, by the member's name.

    Raises
    ------
    InputError
        The file is damaged, repeats a name, or contains links or compressed members, none of which
        `write_archive` writes.
    """
    data = read_bytes(path)
    with naming(path):
        return members_of(data)


def read_member(path: Path, name: str) -> bytes:
    """Return the content of one member of a ZIP file, without reading the others.

    Raises
    ------
    InputError
        There is no such member, or as in `read_archive`.
    """
    with (
        open_file(path) as file,
        naming(path),
        reading("archive", *_DAMAGE),
        zipfile.ZipFile(file) as archive,
    ):
        if name not in _checked_names(archive, path.stat().st_size):
            raise InputError(f"has no member {name}")
        return archive.read(name)


def members_of(data: bytes) -> dict[str, bytes]:
    """Return the content of each member of an archive that is in memory, as `read_archive` does."""
    with reading("archive", *_DAMAGE), zipfile.ZipFile(BytesIO(data)) as archive:
        return {name: archive.read(name) for name in _checked_names(archive, len(data))}


def _checked_names(archive: zipfile.ZipFile, size: int) -> list[str]:
    members = archive.infolist()
    if any(member.compress_type != zipfile.ZIP_STORED for member in members):
        raise InputError("an archive with compressed members, not one of results")
    if sum(member.file_size for member in members) > size:
        raise InputError("a damaged archive: its members are larger than the file")
    if any(stat.S_ISLNK(member.external_attr >> 16) for member in members):
        raise InputError("an archive with links, not one of results")
    names = [member.filename for member in members]
    if len(set(names)) < len(names):
        raise InputError("a damaged archive: two members have the same name")
    return names
