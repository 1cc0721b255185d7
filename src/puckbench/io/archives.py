"""Several files as one artefact: zip archives whose members are stored, not compressed."""

from __future__ import annotations

import struct
import zipfile
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path

from puckbench.core.errors import InputError
from puckbench.core.files import read_bytes, written_whole

SUFFIX = ".zip"
_EPOCH = (1980, 1, 1, 0, 0, 0)
"""The earliest time that a zip archive can hold."""
_REGULAR_FILE = 0o100644 << 16


def write_archive(path: Path, members: Mapping[str, bytes]) -> None:
    """Write an archive of members in their order; the same members give the same bytes."""
    with written_whole(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        for name, data in members.items():
            member = zipfile.ZipInfo(name, _EPOCH)
            member.external_attr = _REGULAR_FILE
            archive.writestr(member, data)


def read_archive(path: Path) -> dict[str, bytes]:
    """Read the members of an archive by name.

    Raises
    ------
    InputError
        The file is missing, damaged, or has a member that is compressed or larger than the file.
    """
    data = read_bytes(path)
    try:
        with zipfile.ZipFile(BytesIO(data)) as archive:
            members = archive.infolist()
            if any(member.compress_type != zipfile.ZIP_STORED for member in members):
                raise InputError(f"{path}: an archive with compressed members, not one of results")
            if sum(member.file_size for member in members) > len(data):
                raise InputError(f"{path}: a damaged archive: its members are larger than the file")
            return {member.filename: archive.read(member) for member in members}
    except (zipfile.BadZipFile, ValueError, RuntimeError, EOFError, OSError, struct.error) as error:
        fault = " ".join(str(error).split())
        raise InputError(f"{path}: not a readable archive ({fault})") from error
