"""What of a finished run is published, so that others can check and repeat it."""

from __future__ import annotations

import hashlib
import os
import platform
import re
import shutil
import sysconfig
from collections.abc import Iterable, Iterator, Mapping
from importlib.metadata import packages_distributions
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import puckbench
from pointkit.errors import InputError
from pointkit.files import read_bytes, refuse_special, unreadable
from pointkit.models import parsed
from pointkit.registry import plugin_packages
from pointkit.yaml_files import yaml_text
from puckbench.codecs.external import program_names
from puckbench.core.archives import SUFFIX
from puckbench.core.environment import cpu_model, installed_versions, source_commit
from puckbench.core.packages import package_folders
from puckbench.planning.config import Sensing, read_config
from puckbench.planning.launch import outdated_files
from puckbench.planning.published_paths import PublishedPaths
from puckbench.planning.running import hold_results
from puckbench.planning.workflow import Workflow
from puckbench.report.run_record import RunRecord
from puckbench.results.bundles import (
    CONFIGURATION,
    FORMAT,
    MANIFEST,
    REFERENCE,
    RESULTS,
    TABLES,
    FileDigest,
    Manifest,
    digests_in,
)
from puckbench.steps.cost import read_costs
from puckbench.steps.fingerprints import covered
from puckbench.steps.sensing import files_named


class Published(NamedTuple):
    """What is published of a run: the manifest, and the content of each member by name."""

    manifest: Manifest
    members: dict[str, bytes]


def published(results: Path, config: Path, with_streams: bool) -> Published:
    """Return what is published of a run that was started in this working folder.

    Parameters
    ----------
    results
        The results folder.
    config
        The configuration of the run.
    with_streams
        Whether to include the streams. Their digests are always included.

    Raises
    ------
    InputError
        The results are of another configuration, incomplete or out of date, or a file of the user's
        code lies where no published name can be found.
    """
    values = read_config(config)
    flow = Workflow(values, check_scenes=True)
    if flow.plan.results.resolve() != results.resolve():
        raise InputError(f"{config}: its results are in {flow.plan.results}, not in {results}")
    hold_results(results)
    if outdated := outdated_files(config):
        raise InputError(
            f"{results}: not the results of {config}, of which {len(outdated)} are missing or made "
            f"otherwise, such as {outdated[0]}: run it first (puckbench run {config})"
        )
    paths = PublishedPaths(values, Path.cwd())
    code = {name: file for file in sorted(_code_of(flow)) for name in paths.names_of(file)}
    settings = {name: file for file in _settings_of(flow) for name in paths.names_of(file)}
    for name in code | settings:
        if name in (CONFIGURATION, MANIFEST) or name.startswith(RESULTS):
            raise InputError(f"{name}: a bundle has its own file or folder there: rename this one")
    members = {
        CONFIGURATION: yaml_text(paths.in_values(values)).encode(),
        **{name: read_bytes(file) for name, file in (code | settings).items()},
        **_tables(flow, paths),
    }
    curves = [f"coded/{'/'.join(curve)}" for curve in flow.plan.curves]
    curves += [name.removesuffix(SUFFIX) for name in flow.drives.artefacts()]
    if with_streams:
        members |= {f"{RESULTS}{n}{SUFFIX}": read_bytes(results / f"{n}{SUFFIX}") for n in curves}
    inputs = {name: file for file in _inputs_of(flow) for name in paths.names_of(file)}
    manifest = {
        "format": FORMAT,
        "commit": source_commit(),
        "versions": {**versions(), **_installed_plugins(flow)},
        "machine": machine(),
        "record": _record(results / "logs"),
        "results": paths.in_text(flow.config.results),
        "plugins": tuple(code),
        "python_path": tuple(_python_path(paths)),
        "files": {},
        "inputs": {
            name: digest_of(inputs[name]) for name in sorted(inputs.keys() - members.keys())
        },
        "programs": dict(_programs_of(flow)),
        "streams": digests_in(results, curves),
        "decoded": digests_in(results, _decoded(flow)),
    }
    return Published(parsed(Manifest, manifest, f"a bundle of {results}"), members)


def _record(logs: Path) -> dict[str, str]:
    facts = RunRecord.of(read_costs(logs)).facts()
    return {name: facts[name] for name in ("Date", "Duration") if name in facts}


def versions() -> dict[str, str]:
    """Return the versions of puckbench, Python, the libraries, and packages with plug-ins here."""
    dists = [point.dist for point in plugin_packages().values() if point.dist is not None]
    return {
        "puckbench": puckbench.__version__,
        "Python": platform.python_version(),
        **installed_versions(),
        **{dist.name: dist.version for dist in dists},
    }


def machine() -> dict[str, str]:
    """Return what is published of this machine, as texts by name."""
    system = f"{platform.system()} {platform.machine()}"
    return {"System": system, "Processor": cpu_model()}


def digest_of(file: Path) -> FileDigest:
    """Return the SHA-256 and the size of a file; raise InputError if it cannot be read."""
    refuse_special(file)
    try:
        with file.open("rb") as stream:
            digest = hashlib.file_digest(stream, "sha256").hexdigest()
            return FileDigest(sha256=digest, bytes=stream.tell())
    except OSError as error:
        raise unreadable(file, error) from error


# ---- files of a run


def _installed_plugins(flow: Workflow) -> dict[str, str]:
    """Return the versions of installed packages whose plug-ins the configuration names."""
    modules = {place.partition(":")[0] for place in flow.config.places()}
    tops = {name.partition(".")[0] for name in modules if not name.endswith(".py")}
    packages = packages_distributions() if tops else {}
    return installed_versions(name for top in sorted(tops) for name in packages.get(top, ()))


def _code_of(flow: Workflow) -> set[Path]:
    """Return the files of the user's code, which count as code of jobs, and what codecs name."""
    places = [place.rpartition(":")[0] for place in flow.config.places()]
    names = [str(Path(name).absolute()) if name.endswith(".py") else name for name in places]
    named = [file for codec in flow.plan.codecs for file in flow.plan.named_files(codec)]
    installed = [*map(Path, sysconfig.get_paths().values()), *package_folders().values()]
    return {
        file
        for file in (*(covered(*names) if names else ()), *named)
        if not any(file.is_relative_to(folder) for folder in installed)
    }


def _python_path(paths: PublishedPaths) -> Iterator[str]:
    """Yield the published names of folders in the working folder where Python finds modules."""
    for folder in map(Path, filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))):
        if Path.cwd() in folder.absolute().parents:
            yield from paths.names_of(folder)


def _settings_of(flow: Workflow) -> set[Path]:
    """Return the files with settings that sensors, sweeps and error models name."""
    drives = flow.drives.entries.values()
    entries: list[Sensing] = [
        *(data.settings for data in flow.plan.datasets.values()),
        *(drive.settings.of_scene(s) for drive in drives for s, _ in drive.scans.values()),
    ]
    files = [f for each in entries if each.is_scan for f in flow.plan.code_of_scan(each)[0].files]
    models = flow.plan.study.models.values() if flow.plan.study else ()
    files += files_named(value for _, options in models for value in options.values())
    return set(map(Path, files))


def _inputs_of(flow: Workflow) -> Iterator[Path]:
    for drives in flow.drives.real:  # whose steps know which files they read
        for drive in flow.drives.entries[drives].drives:
            flow.step("drive_of_clouds", drives=drives, drive=drive)
    ours = package_folders().values()
    named = [path for files in flow.plan.weights.values() for path in files]
    for opened in flow.plan.opened.values():
        named += [Path(program) for program in program_names(opened) if "/" in program]
    for path in (*flow.plan.digests, *named):
        files = sorted(path.rglob("*")) if path.is_dir() else [path]
        for file in files:
            if file.is_file() and not any(file.absolute().is_relative_to(each) for each in ours):
                yield file


def _programs_of(flow: Workflow) -> Iterator[tuple[str, FileDigest]]:
    """Yield the name and the digest of each external program that is found by its name."""
    for opened in flow.plan.opened.values():
        for name in program_names(opened):
            if "/" not in name and (place := shutil.which(name)):
                yield name, digest_of(Path(place))


def _decoded(flow: Workflow) -> Iterator[str]:
    for name in flow.plan.examples.values():
        dataset, cloud = name.split("/")
        for codec in flow.plan.codecs:
            if flow.plan.codes(codec, dataset):
                yield f"decoded/{dataset}/{cloud}/{codec}"


# ---- results


def _tables(flow: Workflow, paths: PublishedPaths) -> dict[str, bytes]:
    """Return the tables of a run as CSV, the meanings of their columns, and the reference results.

    Without results of codecs on clouds there are no reference results.
    """
    folder, outputs = flow.plan.results / "tables", flow.outputs
    members = {}
    for table in (*outputs.gathered, *outputs.tables):
        for name in (f"{table}.csv", f"columns/{table}.csv"):
            text = read_bytes(folder / name).decode()
            members[TABLES + name] = paths.in_text(text).encode()
    if "metrics" in outputs.gathered:
        members[REFERENCE] = _reference(flow, paths)
    return members


def _reference(flow: Workflow, paths: PublishedPaths) -> bytes:
    planned = flow.step("reference")
    contents = planned.step.model_dump()["contents"]
    contents["configuration"] = paths.in_values(contents["configuration"])
    with TemporaryDirectory() as folder:
        file = Path(folder) / Path(REFERENCE).name
        inputs = {name: Path(str(path)) for name, path in planned.inputs.items()}
        planned.step.replaced(contents=contents).run(file, **inputs)
        return file.read_bytes()


# ---- what a person should look at


def private_parts(bundle: Published, words: Iterable[str]) -> dict[str, list[str]]:
    """Return the members of a bundle in which private words stand.

    Parameters
    ----------
    bundle
        What is published.
    words
        Private words, such as the name of the user.

    Returns
    -------
    dict[str, list[str]]
        For each word that was found, the names of the members.
    """
    about = bundle.manifest.model_dump_json().encode()
    members: Mapping[str, bytes] = {**bundle.members, MANIFEST: about}
    found: dict[str, list[str]] = {}
    for word in words:
        pattern = re.compile(rb"(?<!\w)" + re.escape(word.encode()) + rb"(?!\w)")
        if names := [name for name, data in members.items() if pattern.search(data)]:
            found[word] = names
    return found
