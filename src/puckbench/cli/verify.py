from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from puckbench.cli.types import integer, note, refuse

if TYPE_CHECKING:
    from puckbench.results.bundles import Bundle, Manifest


def arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("bundle", type=Path, help="bundle (.zip), as `puckbench bundle` writes it")
    text = (
        "new folder in which to repeat the run and compare the results; this executes the code of "
        "the bundle's plug-ins"
    )
    add("--run", type=Path, metavar="FOLDER", help=text)
    text = (
        "folder with the input files, which are recognised by their digests (default: the working "
        "folder)"
    )
    add("--inputs", type=Path, metavar="FOLDER", help=text)
    add("--cores", type=integer(1), help="with --run: number of cores (default: all)")


def run(options: argparse.Namespace) -> dict[str, Any]:
    """Check a bundle, and return what it is; with ``--run``, also what a repetition gives.

    ``failed`` is the number of kinds of results that differ.
    """
    from puckbench.planning.bundling import digest_of
    from puckbench.planning.repetition import found_inputs
    from puckbench.results.bundles import read_bundle

    if options.run is None:
        refuse(options, {"cores": None}, "only with --run")
    bundle = read_bundle(options.bundle)
    manifest = bundle.manifest
    answer: dict[str, Any] = {
        "bundle": str(options.bundle),
        "sha256": digest_of(options.bundle).sha256,
        "made_by": f"puckbench {manifest.versions.get('puckbench', '?')}, {manifest.commit}",
        "machine": ", ".join(manifest.machine.values()),
        **{name.lower(): text for name, text in manifest.record.items()},
        "plugins": list(manifest.plugins),
        "inputs": len(manifest.inputs),
        "tables": len(bundle.tables),
        "streams": _streams(bundle),
        "files": "all agree with the manifest",
        "different_here": list(_differences_here(manifest)),
    }
    if options.run is not None or options.inputs is not None:
        search = options.inputs is not None
        inputs = found_inputs(bundle, options.inputs or Path(), search)
        answer["inputs"] = f"{len(inputs)}, all found"
        if options.run is not None:
            answer |= _repeated(bundle, options.run, inputs, options.cores)
    return answer


def _streams(bundle: Bundle) -> str:
    from puckbench.core.archives import SUFFIX
    from puckbench.results.bundles import RESULTS

    streams = bundle.manifest.streams
    inside = all(f"{RESULTS}{name}{SUFFIX}" in bundle.members for name in streams)
    return f"{sum(map(len, streams.values()))}{'' if inside else ', by their digests'}"


def _differences_here(manifest: Manifest) -> Iterator[dict[str, str]]:
    """Yield versions, machine and programs that differ, as texts by heading."""
    import shutil

    from puckbench.core.environment import source_commit
    from puckbench.planning.bundling import digest_of, machine, versions

    facts = {**versions(), "commit": source_commit(), **machine()}
    told = {**manifest.versions, "commit": manifest.commit, **manifest.machine}
    for name, there in told.items():
        if (here := facts.get(name, "")) != there:
            yield {"what": name, "there": there, "here": here}
    for name, digest in manifest.programs.items():
        place = shutil.which(name)
        found = digest_of(Path(place)) if place else None
        if found != digest:
            here = found.sha256[:16] if found else "not found"
            yield {"what": f"program {name}", "there": digest.sha256[:16], "here": here}


def _repeated(
    bundle: Bundle, folder: Path, inputs: dict[str, Path], cores: int | None
) -> dict[str, Any]:
    from puckbench.planning.repetition import run_again, unpack

    unpack(bundle, folder, inputs)
    code = ", ".join(bundle.manifest.plugins) or "none"
    note(f"repeats the run in {folder}; plug-ins of the bundle that are executed: {code}")
    found = [each._asdict() for each in run_again(bundle, folder, cores)]
    same = "the same results, apart from times, memory and the machine"
    verdict = "different results" if found else same
    return {"differences": found, "verdict": verdict, "failed": len(found)}
