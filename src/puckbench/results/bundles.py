"""Bundles: a run's configuration, plug-ins, results and environment in one archive to publish.

A bundle is an archive whose member `MANIFEST` lists all other members with their digests. Inputs,
external programs, and streams that are not in the bundle are known by their digests.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, NonNegativeInt, StringConstraints

from pointkit.errors import InputError, naming
from pointkit.files import json_bytes, object_of
from pointkit.models import Model, parsed
from puckbench.core.archives import SUFFIX, members_of, read_archive, write_archive
from puckbench.results.curves import RECORD

FORMAT = 1
MANIFEST = "manifest.json"
CONFIGURATION = "configuration.yaml"
RESULTS = "results/"
"""Folder, in a bundle, of files from the results folder."""
TABLES = f"{RESULTS}tables/"
REFERENCE = f"{RESULTS}reference.parquet"
"""Member with the results in the form of reference results, which others compare with."""
_MOST_LETTERS = 1000
_DRIVE = re.compile(r"[A-Za-z]:")


def _safe(name: str) -> str:
    """Return a path of a file in a bundle if it stays in the folder that it is written to."""
    parts = name.split("/")
    if (
        {"", ".", ".."} & {*parts}
        or "\\" in name
        or not name.isprintable()
        or _DRIVE.match(name)
        or len(name) > _MOST_LETTERS
    ):
        raise ValueError(f"{name[:80]!r} is not a path inside a folder")
    return name


def _printable(text: str) -> str:
    if not text.isprintable():
        raise ValueError(f"{text[:80]!r} has characters that cannot be printed")
    return text


Name = Annotated[str, AfterValidator(_safe)]
"""Path of a file, relative to the folder in which the run was started."""
Text = Annotated[str, AfterValidator(_printable)]
Digest = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]
"""SHA-256 in hexadecimal."""
Digests = Mapping[str, Mapping[str, str]]
"""Digests of archives' members, by the archive's path in the results folder without suffix."""


class FileDigest(Model):
    """The SHA-256 and the size of a file that is not in the bundle."""

    sha256: Digest
    bytes: NonNegativeInt


class Manifest(Model, extra="ignore"):
    """What a bundle contains, and where its results come from.

    Parameters
    ----------
    format
        Version of the format of bundles.
    commit
        Commit of the sources of puckbench; empty if unknown.
    versions
        Versions of puckbench, Python and the libraries, by name.
    machine
        Facts about the machine, as texts by name.
    record
        Date and duration of the run (`puckbench.report.run_record.RunRecord`), as texts by name.
    results
        Results folder of the configuration.
    plugins
        Members with code of the author, which a re-run executes, and files that codecs name.
    python_path
        Folders with such members in which Python searches for modules.
    files
        Digest of each member but the manifest.
    inputs
        Input files that the bundle does not contain.
    programs
        External programs that codecs run, by name.
    streams, decoded
        Digests of all streams, and of the decoded clouds that the run keeps.
    """

    format: int
    commit: Text = ""
    versions: Mapping[Text, Text]
    machine: Mapping[Text, Text] = {}
    record: Mapping[Text, Text] = {}
    results: Name
    plugins: tuple[Name, ...] = ()
    python_path: tuple[Name, ...] = ()
    files: Mapping[Name, Digest]
    inputs: Mapping[Name, FileDigest] = {}
    programs: Mapping[Name, FileDigest] = {}
    streams: Mapping[Name, Mapping[Name, Digest]] = {}
    decoded: Mapping[Name, Mapping[Name, Digest]] = {}


@dataclass(frozen=True)
class Bundle:
    """A bundle whose contents agree with its manifest.

    Parameters
    ----------
    path
        Path of the archive.
    manifest
        The manifest.
    members
        Content of each member but the manifest.
    """

    path: Path
    manifest: Manifest
    members: Mapping[str, bytes]

    @property
    def tables(self) -> dict[str, bytes]:
        """Contents of the result tables, which are CSV files, by the table's name."""
        return {
            name.removeprefix(TABLES).removesuffix(".csv"): data
            for name, data in self.members.items()
            if re.fullmatch(rf"{TABLES}\w+\.csv", name)
        }


def write_bundle(path: Path, manifest: Manifest, members: Mapping[str, bytes]) -> None:
    """Write a bundle; equal contents give the same bytes.

    Parameters
    ----------
    path
        File to write.
    manifest
        The manifest; the digests of the members are added.
    members
        Content of each member but the manifest, by name.

    Raises
    ------
    InputError
        A member has a name that is not the path of a file inside a folder.
    """
    ordered = dict(sorted(members.items()))
    files = {name: sha256_of(data) for name, data in ordered.items()}
    complete = parsed(Manifest, {**dict(manifest), "files": files}, str(path))
    about = json_bytes(complete.model_dump(mode="json"))
    write_archive(path, {MANIFEST: about, **ordered})


def read_bundle(path: Path) -> Bundle:
    """Read a bundle; nothing that it contains is executed.

    Raises
    ------
    InputError
        The file is not a bundle, or a member was changed, added or removed after it was made.
    """
    members = read_archive(path)
    with naming(path):
        if MANIFEST not in members:
            raise InputError(f"not a bundle of puckbench, without {MANIFEST}")
        manifest = _manifest(members.pop(MANIFEST))
        _check_files(members, manifest.files)
        for name, digests in manifest.streams.items():
            data = members.get(f"{RESULTS}{name}{SUFFIX}")
            if data is not None and stream_digests(data) != digests:
                raise InputError(f"the streams of {name} are not those of the manifest")
    return Bundle(path, manifest, members)


def _manifest(data: bytes) -> Manifest:
    about = object_of(data, MANIFEST)
    if about.get("format") != FORMAT:
        raise InputError(f"format {about.get('format')!r}, but this version reads {FORMAT}")
    manifest = parsed(Manifest, about, MANIFEST)
    names = {*manifest.files, *manifest.inputs}
    for name in sorted(names):
        folders = Path(name).parents
        if inner := next((str(each) for each in folders if str(each) in names), None):
            raise InputError(f"{MANIFEST}: {inner!r} is both a file and a folder")
    return manifest


def _check_files(members: Mapping[str, bytes], digests: Mapping[str, str]) -> None:
    for name in (*members, *digests):
        if name not in digests:
            raise InputError(f"{name[:80]!r} is not in the manifest")
        if name not in members:
            raise InputError(f"without {name}, which is in the manifest")
        if sha256_of(members[name]) != digests[name]:
            raise InputError(f"{name} was changed: its SHA-256 is not that of the manifest")


def sha256_of(data: bytes) -> str:
    """Return the SHA-256 of bytes in hexadecimal."""
    return hashlib.sha256(data).hexdigest()


def stream_digests(data: bytes) -> dict[str, str]:
    """Return the SHA-256 of each stream or cloud in an archive of results, by the member's name.

    Records, which contain times, are left out.
    """
    members = members_of(data)
    return {name: sha256_of(each) for name, each in members.items() if not name.endswith(RECORD)}


def digests_in(folder: Path, names: Iterable[str]) -> dict[str, dict[str, str]]:
    """Return the `stream_digests` of those of some archives in a folder that exist, by name.

    `names` are the paths of the archives in the folder, without the suffix.
    """
    paths = {name: folder / f"{name}{SUFFIX}" for name in names}
    return {name: _digests_of(path) for name, path in paths.items() if path.exists()}


def _digests_of(path: Path) -> dict[str, str]:
    with naming(path):
        return stream_digests(path.read_bytes())
