"""Archives of results: uncompressed ZIP files, such as the streams of a cloud at all rates."""

from __future__ import annotations

import stat
import struct
import zipfile
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path

from pointkit.damage import reading
from pointkit.errors import InputError, naming
from pointkit.files import read_bytes, written_whole

SUFFIX = ".zip"
_EPOCH = (1980, 1, 1, 0, 0, 0)
"""Earliest time that a ZIP file can store."""
_DAMAGE = (zipfile.BadZipFile, ValueError, RuntimeError, EOFError, OSError, struct.error)
_REGULAR_FILE = 0o100644 << 16


def write_archive(path: Path, members: Mapping[str, bytes]) -> None:
    """Write an uncompressed ZIP file.

    The time of writing is not stored, so equal members always give the same bytes.

    Parameters
    ----------
    path
        File to write.
    members
        Content of each member of the archive, by the member's name.
    """
    with written_whole(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        for name, data in members.items():
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


def members_of(data: bytes) -> dict[str, bytes]:
    """Return the content of each member of an archive that is in memory, as `read_archive` does."""
    with reading("archive", *_DAMAGE), zipfile.ZipFile(BytesIO(data)) as archive:
        members = archive.infolist()
        if any(member.compress_type != zipfile.ZIP_STORED for member in members):
            raise InputError("an archive with compressed members, not one of results")
        if sum(member.file_size for member in members) > len(data):
            raise InputError("a damaged archive: its members are larger than the file")
        if any(stat.S_ISLNK(member.external_attr >> 16) for member in members):
            raise InputError("an archive with links, not one of results")
        contents = {member.filename: archive.read(member) for member in members}
        if len(contents) < len(members):
            raise InputError("a damaged archive: two members have the same name")
        return contents
