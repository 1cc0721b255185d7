"""Files that others published on GitHub, such as weights, recordings, and turns of drives.

They are downloaded, or taken from a clone. Tables (.yaml) beside this module list them, with
commits and hashes.
"""

from __future__ import annotations

import hashlib
import io
import tarfile
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from pointkit.errors import InputError, naming
from pointkit.files import read_bytes
from pointkit.yaml_files import read_yaml

HOST = "https://raw.githubusercontent.com"
_TIMEOUT_S = 60
_MAX_BYTES = 2**26
_OPTIMISER = "main_optimizer/"


PCGC = "pcgc_weights"
TABLES = (
    *(PCGC, "reno_weights", "lizip_weights", "polopcac_weights", "ouster_recordings"),
    *("sfnd_lidar_1", "sfnd_lidar_2", "sfnd_tracking", "inter_lpcm_turns"),
)
"""Names of the tables of files to download. Table NAME is the file NAME.yaml beside this module."""


def published(name: str = PCGC) -> dict[str, Any]:
    """Return a table of files to download, with repositories, commits and hashes."""
    content: dict[str, Any] = read_yaml(Path(__file__).with_name(f"{name}.yaml"))
    return content


def download(
    folder: Path, host: str = HOST, table: Mapping[str, Any] | None = None, name: str = PCGC
) -> Path:
    """Download published files and their licences from GitHub, and check all hashes.

    Parameters
    ----------
    folder
        Folder in which the archive is written.
    host
        Address of the server.
    table
        Files, repositories and hashes; by default, the table `name`.
    name
        Name of a table, one of `TABLES`, and of the archive.

    Returns
    -------
    Path
        The tar archive with the files.
    """
    table = table or published(name)
    return _packed(folder, name, table, partial(_fetch, host, table["repositories"]))


def from_clone(
    folder: Path, clone: Path, table: Mapping[str, Any] | None = None, name: str = PCGC
) -> Path:
    """Take published files from a clone of their repository, and check all hashes.

    Parameters
    ----------
    folder
        Folder in which the archive is written.
    clone
        Folder of the clone, or of several clones with the names of their repositories.
    table, name
        As for `download`.

    Returns
    -------
    Path
        The tar archive with the files.
    """
    table = table or published(name)
    return _packed(folder, name, table, partial(_of_clone, clone, table["repositories"]))


def _packed(
    folder: Path, name: str, table: Mapping[str, Any], fetch: Callable[[str], bytes]
) -> Path:
    package = folder / f"{name}.tar"
    with tarfile.open(package, "w") as archive:
        for file, entry in table["files"].items():
            content = _file(file, entry, fetch, table)
            member = tarfile.TarInfo(file)
            member.size = len(content)
            archive.addfile(member, io.BytesIO(content))
    return package


def _file(
    name: str, entry: Mapping[str, Any], fetch: Callable[[str], bytes], table: Mapping[str, Any]
) -> bytes:
    parts = [fetch(place) for place in entry.get("from") or [f"{table['within']}/{name}"]]
    if "git" in entry and [_git_name(part) for part in parts] != entry["git"]:
        raise InputError(f"{name}: the repository's content differs from the published one")
    content = parts[0] if len(parts) == 1 else _archive(name, parts, table["order"])
    if len(content) != entry.get("bytes", len(content)):
        raise InputError(f"{name} has {len(content)} bytes, not the expected {entry['bytes']}")
    digest = hashlib.sha256(content).hexdigest()
    if digest != entry.get("sha256", digest):
        raise InputError(f"{name} has the SHA-256 {digest}, not the expected {entry['sha256']}")
    return content


def _fetch(host: str, repositories: Mapping[str, str], place: str) -> bytes:
    from http.client import HTTPException
    from urllib.error import URLError
    from urllib.request import urlopen

    repository, _, path = place.partition("/")
    address = f"{host}/{repositories[repository]}/{path}"
    try:
        with urlopen(address, timeout=_TIMEOUT_S) as answer:  # noqa: S310 (the host is ours)
            content: bytes = answer.read(_MAX_BYTES)
    except (URLError, OSError, HTTPException) as error:
        reason = getattr(error, "reason", error)
        raise InputError(f"{address} cannot be fetched ({reason})") from error
    return content


def _of_clone(clone: Path, repositories: Mapping[str, str], place: str) -> bytes:
    repository, _, path = place.partition("/")
    owner, project, commit = repositories[repository].split("/")
    files = (clone / project / path, clone / path)
    file = next(filter(Path.is_file, files), None)
    if file is None:
        expected = f"expected a clone of github.com/{owner}/{project} at {commit[:8]}"
        raise InputError(f"{clone}: no file {path} ({expected})")
    return read_bytes(file)


def _git_name(content: bytes) -> str:
    return hashlib.sha1(b"blob %d\0" % len(content) + content, usedforsecurity=False).hexdigest()


def _archive(name: str, checkpoint: Sequence[bytes], order: str) -> bytes:
    import numpy as np

    from puckbench.scene_sets.tensorflow_checkpoints import read_variables

    with naming(name):
        variables = read_variables(*checkpoint)
    names = sorted(name for name in variables if not name.startswith(_OPTIMISER))
    order_of_variables = bytes.fromhex(order)
    if len(names) != len(order_of_variables):
        raise InputError(f"{name}: {len(names)} variables, not {len(order_of_variables)}")
    archive = io.BytesIO()
    np.savez(archive, **{names[place]: variables[names[place]] for place in order_of_variables})  # type: ignore[arg-type]
    return archive.getvalue()


def credits_text(name: str, _: Path) -> str:
    return str(published(name)["credits"])


def terms_of(name: str) -> str:
    """Return the licence terms of the published files that a table lists, as plain text.

    `name` is one of `TABLES`. The text is empty if the table states no terms.
    """
    return str(published(name).get("terms", ""))
