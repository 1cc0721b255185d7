"""Repeats the run of a bundle in a new folder, and compares the results."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from pointkit.errors import InputError, naming
from pointkit.files import read_bytes, write_bytes
from puckbench.planning.bundling import digest_of
from puckbench.planning.launch import run_workflow, snakemake_command
from puckbench.results.bundles import (
    CONFIGURATION,
    RESULTS,
    Bundle,
    Digests,
    FileDigest,
    digests_in,
)
from puckbench.results.sameness import table_difference
from puckbench.tables.registry import table_entries


class Difference(NamedTuple):
    """A kind of result that differs between two runs, and how it does, in words."""

    what: str
    how: str


def found_inputs(bundle: Bundle, folder: Path, search: bool) -> dict[str, Path]:
    """Return the input files that a bundle names, by name.

    A file is recognised by its SHA-256. It is looked for in a folder by its relative path and by
    its file name.

    Parameters
    ----------
    bundle
        The bundle.
    folder
        Folder with the input files.
    search
        Whether to look also for a file of the same size anywhere in the folder.

    Raises
    ------
    InputError
        A file is missing.
    """
    by_size: dict[int, list[Path]] = {}
    for file in sorted(folder.rglob("*")) if search and bundle.manifest.inputs else ():
        if file.is_file():
            by_size.setdefault(file.stat().st_size, []).append(file)
    found = {}
    for name, digest in bundle.manifest.inputs.items():
        likely = [folder / name, folder / Path(name).name]
        files = [*likely, *by_size.get(digest.bytes, ())]
        match = next((file for file in files if _has(file, digest)), None)
        if match is None:
            what = f"no file {name} ({digest.bytes:,} bytes, SHA-256 {digest.sha256}) in {folder}"
            raise InputError(f"{bundle.path}: {what}: name its folder (--inputs)")
        found[name] = match
    return found


def _has(file: Path, digest: FileDigest) -> bool:
    return file.is_file() and file.stat().st_size == digest.bytes and digest_of(file) == digest


def unpack(bundle: Bundle, folder: Path, inputs: Mapping[str, Path]) -> None:
    """Write what a run needs of a bundle, and its input files, to a new folder.

    Parameters
    ----------
    bundle
        The bundle.
    folder
        The folder, which must be empty if it exists.
    inputs
        Input files by name. They are linked or, on another file system, copied.

    Raises
    ------
    InputError
        The folder has files.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f"{folder}: exists, and a bundle is unpacked to a new folder")
    for name, data in bundle.members.items():
        if not name.startswith(RESULTS):
            write_bytes(folder / name, data)
    for name, file in inputs.items():
        place = folder / name
        place.parent.mkdir(parents=True, exist_ok=True)
        try:
            os.link(file.resolve(), place)
        except OSError:
            shutil.copy2(file, place)


def run_again(bundle: Bundle, folder: Path, cores: int | None) -> Iterator[Difference]:
    """Run an unpacked bundle, which executes its plug-ins, and yield what differs from its results.

    Parameters
    ----------
    bundle
        The bundle.
    folder
        The folder to which it was unpacked.
    cores
        Maximum number of cores; None uses all.

    Yields
    ------
    Difference
        Each kind of result that differs, apart from times, memory and the machine.
    """
    command = snakemake_command(Path(CONFIGURATION), cores)
    manifest = bundle.manifest
    python_path = [
        (folder / name).absolute()
        for name in manifest.python_path
        if any(member.startswith(f"{name}/") for member in manifest.plugins)
    ]
    status = run_workflow(command, quiet=True, goes_on=True, python_path=python_path, folder=folder)
    results = folder / manifest.results
    if status:
        logs = f" (logs: {results / 'logs'})" if (results / "logs").exists() else ""
        yield Difference("run", f"ended with exit status {status}{logs}")
    yield from differences(bundle, results)


def differences(bundle: Bundle, results: Path) -> Iterator[Difference]:
    """Yield each kind of result in a folder that differs from a bundle's, as `run_again` does."""
    for what in ("streams", "decoded clouds"):
        expected = bundle.manifest.streams if what == "streams" else bundle.manifest.decoded
        yield from _differing_archives(what, expected, digests_in(results, expected))
    entries = table_entries()
    for name, data in bundle.tables.items():
        path = results / "tables" / f"{name}.csv"
        if not path.exists():
            yield Difference(f"table {name}", "is missing")
            continue
        timed = entries[name].timed if name in entries else {}
        with naming(path):
            if difference := table_difference(data, read_bytes(path), timed):
                yield Difference(f"table {name}", difference)


def _differing_archives(what: str, expected: Digests, found: Digests) -> Iterator[Difference]:
    places = [(archive, name) for archive, digests in expected.items() for name in digests]
    missing = [each for each in places if each[1] not in found.get(each[0], {})]
    others = [
        (archive, name)
        for archive, name in places
        if (archive, name) not in missing and found[archive][name] != expected[archive][name]
    ]
    for kind, odd in (("differ", others), ("are missing", missing)):
        if odd:
            yield Difference(what, f"{len(odd)} of {len(places)} {kind}, first {'/'.join(odd[0])}")
