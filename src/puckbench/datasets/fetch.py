"""Fetching the free data sets through package managers, with hashes, licences and credits."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from puckbench.core.errors import InputError, among
from puckbench.core.files import read_json, sha256, write_bytes, write_json
from puckbench.datasets.sources import SOURCES, Source

_RECORD = "fetched.json"
_CREDITS = "CREDITS.md"


@dataclass(frozen=True)
class Fetched:
    """The outcome of fetching one data set.

    Parameters
    ----------
    name, folder
        Of the data set.
    status
        "fetched", "present" (its files are there, with the hashes recorded when they were fetched)
        or "failed".
    message
        The reason, or a warning; may be empty.
    """

    name: str
    folder: Path
    status: str
    message: str = ""


def fetch_data(root: Path, names: Iterable[str] = ()) -> list[Fetched]:
    """Fetch free data sets into folders of their names.

    Safe to repeat: intact folders are left alone, incomplete ones fetched again. A data set that
    fails does not keep the others from being fetched.

    Parameters
    ----------
    root
        Folder of the folders.
    names
        Names in `SOURCES`; by default those that say so.

    Raises
    ------
    InputError
        A name is unknown.
    """
    chosen = list(names) or [name for name, source in SOURCES.items() if source.by_default]
    unknown = [name for name in chosen if name not in SOURCES]
    if unknown:
        raise InputError(f"no data set '{unknown[0]}' to fetch{among(unknown[0], SOURCES)}")
    return [_fetch_or_fail(name, root / name) for name in chosen]


def _fetch_or_fail(name: str, folder: Path) -> Fetched:
    if _is_intact(folder):
        return Fetched(name, folder, "present")
    try:
        return Fetched(name, folder, "fetched", fetch_source(SOURCES[name], folder))
    except (InputError, OSError) as error:
        return Fetched(name, folder, "failed", str(error))


def fetch_source(source: Source, folder: Path) -> str:
    """Fetch one package's files into `folder`; returns a warning or nothing."""
    workplace = folder.with_name(f".fetching-{folder.name}")
    shutil.rmtree(workplace, ignore_errors=True)  # left there by a run that was killed
    workplace.mkdir(parents=True)
    try:
        package = source.download(workplace)
        warning = _check_hash(source, package)
        unpacked = workplace / "unpacked"
        _unpack(source, package, unpacked)
        write_bytes(unpacked / _CREDITS, source.credits(unpacked).encode())
        record = {"package": package.name, "sha256": sha256(package), "files": _hashes(unpacked)}
        _move_into(folder, unpacked)
        write_json(folder / _RECORD, record)
    finally:
        shutil.rmtree(workplace, ignore_errors=True)
    return warning


def _is_intact(folder: Path) -> bool:
    """Whether every file recorded when the folder was filled is there, unchanged."""
    try:
        files = read_json(folder / _RECORD)["files"]
        return all(sha256(folder / name) == noted for name, noted in files.items())
    except (InputError, KeyError, TypeError):
        return False


def _check_hash(source: Source, package: Path) -> str:
    if source.hashes is None:
        return ""
    known, held = source.hashes.get(package.name), sha256(package)
    if held == known:
        return ""
    fault = f"{package.name} has the SHA-256 {held}, "
    fault += f"not the known {known}" if known else "which is not a version known here"
    if source.pinned:
        raise InputError(fault)
    return f"{fault}; results may differ from those published"


def _unpack(source: Source, package: Path, folder: Path) -> None:
    """Write the wanted files of the package into one flat folder."""
    with source.unpack(package) as archive:
        members = [m for m in archive if m.isfile() and source.wanted.fullmatch(m.name)]
        for member in members:
            content = archive.extractfile(member)
            write_bytes(folder / Path(member.name).name, content.read() if content else b"")
    if not members:
        raise InputError(f"{package.name}: nothing in it looks like {source.wanted.pattern}")


def _hashes(folder: Path) -> dict[str, str]:
    return {path.name: sha256(path) for path in sorted(folder.iterdir())}


def _move_into(folder: Path, unpacked: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for path in unpacked.iterdir():
        os.replace(path, folder / path.name)
