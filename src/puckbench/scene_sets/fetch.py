from __future__ import annotations

import os
import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from pointkit.errors import InputError, among
from pointkit.files import read_json, sha256, write_bytes, write_json
from puckbench.scene_sets.sources import SOURCES, PackageSource

_RECORD = "fetched.json"
_CREDITS = "CREDITS.md"


@dataclass(frozen=True)
class FetchResult:
    """The result of downloading a published data set.

    `status` is "fetched", "present" (the folder was complete already) or "failed". `message` is a
    warning, an error, or the terms of the licence, or empty.
    """

    name: str
    folder: Path
    status: str
    message: str = ""


def fetch_data(
    root: Path, names: Iterable[str] = (), clone: Path | None = None
) -> list[FetchResult]:
    """Download free published data sets, each into a folder with its name.

    A folder that is complete and unchanged is kept. A failure does not stop other downloads.

    Parameters
    ----------
    root
        Folder in which the folders of the data sets are made.
    names
        Names of the data sets, keys of `SOURCES`; by default, all sources with ``by_default``.
    clone
        Folder of a clone of the repository that has the files, or of several clones with the names
        of their repositories. Files are then taken from there, not downloaded.

    Returns
    -------
    list of FetchResult
        A result for each data set, in the order of the names.

    Raises
    ------
    InputError
        A name is unknown, or a data set that is a package shall come from a clone.
    """
    requested = list(names) or [name for name, source in SOURCES.items() if source.by_default]
    unknown = [name for name in requested if name not in SOURCES]
    if unknown:
        raise InputError(f"no data set '{unknown[0]}' to fetch{among(unknown[0], SOURCES)}")
    packages = [name for name in requested if SOURCES[name].from_clone is None]
    if clone is not None and packages:
        raise InputError(f"{packages[0]}: a package of npm or Debian, which is in no clone")
    return [_fetch_or_fail(name, root / name, clone) for name in requested]


def _fetch_or_fail(name: str, folder: Path, clone: Path | None) -> FetchResult:
    source = SOURCES[name]
    if _is_intact(folder):
        return FetchResult(name, folder, "present", source.terms())
    try:
        warning = fetch_source(source, folder, clone)
        return FetchResult(name, folder, "fetched", warning or source.terms())
    except (InputError, OSError) as error:
        return FetchResult(name, folder, "failed", str(error))


def fetch_source(source: PackageSource, folder: Path, clone: Path | None = None) -> str:
    """Download a package, or take its files from a clone, and extract them into a folder.

    The result is a warning, or "" if there is none.
    """
    workspace = folder.with_name(f".fetching-{folder.name}")
    shutil.rmtree(workspace, ignore_errors=True)  # left there by a run that was killed
    workspace.mkdir(parents=True)
    try:
        package = _package(source, workspace, clone)
        warning = _check_hash(source, package)
        unpacked = workspace / "unpacked"
        _unpack(source, package, unpacked)
        write_bytes(unpacked / _CREDITS, source.credits(unpacked).encode())
        record = {"package": package.name, "sha256": sha256(package), "files": _hashes(unpacked)}
        _move_into(folder, unpacked)
        write_json(folder / _RECORD, record)
    finally:
        shutil.rmtree(workspace, ignore_errors=True)
    return warning


def _package(source: PackageSource, workspace: Path, clone: Path | None) -> Path:
    if clone is None or source.from_clone is None:
        return source.download(workspace)
    return source.from_clone(workspace, clone)


def _is_intact(folder: Path) -> bool:
    try:
        files = read_json(folder / _RECORD)["files"]
        return all(sha256(folder / name) == noted for name, noted in files.items())
    except (InputError, KeyError, TypeError):
        return False


def _check_hash(source: PackageSource, package: Path) -> str:
    if source.hashes is None:
        return ""
    expected, actual = source.hashes.get(package.name), sha256(package)
    if actual == expected:
        return ""
    fault = f"{package.name} has the SHA-256 {actual}, "
    fault += f"not the expected {expected}" if expected else "and belongs to no known version"
    if source.pinned:
        raise InputError(fault)
    return f"{fault}; results may differ from those published"


def _unpack(source: PackageSource, package: Path, folder: Path) -> None:
    with source.unpack(package) as archive:
        members = [m for m in archive if m.isfile() and source.members.fullmatch(m.name)]
        for member in members:
            content = archive.extractfile(member)
            place = member.name if source.keeps_folders else Path(member.name).name
            write_bytes(folder / place, content.read() if content else b"")
    if not members:
        raise InputError(f"{package.name}: no member matches {source.members.pattern}")


def _hashes(folder: Path) -> dict[str, str]:
    return {path.relative_to(folder).as_posix(): sha256(path) for path in _files_below(folder)}


def _move_into(folder: Path, unpacked: Path) -> None:
    for path in _files_below(unpacked):
        place = folder / path.relative_to(unpacked)
        place.parent.mkdir(parents=True, exist_ok=True)
        os.replace(path, place)


def _files_below(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file())
