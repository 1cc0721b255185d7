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
    """The result of downloading a data set.

    `status` is "fetched", "present" (the folder was complete already) or "failed". `message` is a
    warning or an error, or empty.
    """

    name: str
    folder: Path
    status: str
    message: str = ""


def fetch_data(root: Path, names: Iterable[str] = ()) -> list[FetchResult]:
    """Download free data sets, each into a folder with its name.

    A folder that is complete and unchanged is kept. A failure does not stop other downloads.

    Parameters
    ----------
    root
        Folder in which the folders of the data sets are made.
    names
        Names of the data sets, keys of `SOURCES`; by default, all sources with ``by_default``.

    Returns
    -------
    list of FetchResult
        A result for each data set, in the order of the names.

    Raises
    ------
    InputError
        A name is unknown.
    """
    requested = list(names) or [name for name, source in SOURCES.items() if source.by_default]
    unknown = [name for name in requested if name not in SOURCES]
    if unknown:
        raise InputError(f"no data set '{unknown[0]}' to fetch{among(unknown[0], SOURCES)}")
    return [_fetch_or_fail(name, root / name) for name in requested]


def _fetch_or_fail(name: str, folder: Path) -> FetchResult:
    if _is_intact(folder):
        return FetchResult(name, folder, "present")
    try:
        return FetchResult(name, folder, "fetched", fetch_source(SOURCES[name], folder))
    except (InputError, OSError) as error:
        return FetchResult(name, folder, "failed", str(error))


def fetch_source(source: PackageSource, folder: Path) -> str:
    """Download a package and extract its files into a folder.

    The result is a warning, or "" if there is none.
    """
    workspace = folder.with_name(f".fetching-{folder.name}")
    shutil.rmtree(workspace, ignore_errors=True)  # left there by a run that was killed
    workspace.mkdir(parents=True)
    try:
        package = source.download(workspace)
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
            write_bytes(folder / Path(member.name).name, content.read() if content else b"")
    if not members:
        raise InputError(f"{package.name}: no member matches {source.members.pattern}")


def _hashes(folder: Path) -> dict[str, str]:
    return {path.name: sha256(path) for path in sorted(folder.iterdir())}


def _move_into(folder: Path, unpacked: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for path in unpacked.iterdir():
        os.replace(path, folder / path.name)
