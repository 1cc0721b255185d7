"""`puckbench run`: codecs compared on a user's own clouds, meshes and recordings."""

from __future__ import annotations

import argparse
import json
import os
import shlex
import subprocess
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from puckbench.cli.types import chosen, units, whole
from puckbench.core.errors import InputError
from puckbench.planning.config import read_config, trusted
from puckbench.planning.launch import TOLD_BY_CALLER, snakemake_command
from puckbench.planning.outputs import OutputJobs
from puckbench.planning.own_files import (
    CODECS,
    CODECS_OF_RECORDINGS,
    CONFIG,
    OwnRun,
    write_configuration,
)
from puckbench.planning.run_summary import REPORT, closing_lines, summary_rows
from puckbench.planning.running import left_out_lines
from puckbench.planning.workflow import Workflow

_OUT = "out"
_CONFIGS = (".yaml", ".yml")
_OF_CONFIG = (
    *("codecs", "frame", "rates", "metrics", "scan", "errors", "points", "limit", "strict"),
    *("metres_per_unit", "up", "drop_invalid", "keep_missing", "bin_columns", "peak", "out"),
    "timeout",
)
"""Options that a configuration has keys for."""
_OF_LOADERS = ("up", "drop_invalid", "keep_missing", "bin_columns")


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add = parser.add_argument
    add(
        "files",
        nargs="*",
        help="clouds (PLY, PCD, LAS, LAZ, E57, XYZ, CSV, TXT, NPY, NPZ, KITTI's .bin), meshes "
        "(OBJ, OFF, PLY, STL, GLB), recordings (.pcap, .bag, .mcap, ...), folders or patterns; or "
        "one configuration (.yaml), and after -- words for Snakemake",
    )
    add(
        "--codecs",
        nargs="+",
        metavar="CODEC",
        help="names (puckbench codecs), or path/to/file.py:Class; the others are compared with the "
        f"first (default: {' '.join(CODECS)}; for recordings {' '.join(CODECS_OF_RECORDINGS)})",
    )
    add(
        "--study",
        metavar="STUDY",
        help="code the clouds of reference results (puckbench compare --help names them)",
    )
    add("--datasets", nargs="+", metavar="NAME", help="of the study (default: all)")
    add("--out", type=Path, help="folder for everything that is made (default: out)")
    add(
        "--frame",
        choices=("scaled", "metric"),
        help="scaled to a cube of 1024, rates r1, r2, ...; or in metres, rates 100mm, 10mm, ... "
        "(default: metric for clouds that are all LAS, LAZ, E57 or .bin, and recordings)",
    )
    add(
        "--metres-per-unit",
        nargs="+",
        metavar="NUMBER",
        help="length of the files' unit (0.001: millimetres; default: 1), or of some files' alone: "
        "FILE=NUMBER ...",
    )
    add(
        "--peak",
        type=float,
        help="of the PSNRs of clouds in metres, in m (default: 30; papers on KITTI take 59.7)",
    )
    add(
        "--rates",
        nargs="+",
        metavar="RATE",
        help="names, or all (default: all, or four where all would take long)",
    )
    add("--metrics", nargs="+", metavar="METRIC", help="further ones: density, file.py:function")
    add("--limit", type=whole(1), help="use at most this many files of a kind")
    add("--scan", action="store_true", help="scan meshes by a virtual VLP-16, not sample them")
    add("--errors", help="error model of the sensor (default: vlp16_divergence)")
    add("--points", type=whole(1), help="sampled from a mesh (default: 100000)")
    add("--up", choices=("y", "z"), help="axis of meshes that points up (default: z)")
    add("--drop-invalid", action="store_true", help="leave out points that are not finite")
    add("--keep-missing", action="store_true", help="keep a sensor's missing returns as points")
    add(
        "--bin-columns",
        metavar="COLUMNS",
        help="of .bin files: 3 to 6, or names: x,y,z,intensity,ring (default: as values tell)",
    )
    add("--strict", action="store_true", help="stop where a file cannot be used, not leave it out")
    add("--timeout", type=float, metavar="SECONDS", help="of a job, after which it fails")
    add("--cores", type=whole(1), help="default: all")


def run(options: argparse.Namespace) -> dict[str, Any] | None:
    """Write the configuration and run the workflow, which tells its results in a table."""
    path, more = _configuration(options)
    is_told_here = not (options.json or more)
    status = _run_workflow(
        snakemake_command(path, options.cores, *more), options.json, is_told_here
    )
    rest = _without_failures(path) if status and not more else None
    if rest:
        print("puckbench: now tables and report of the others", file=sys.stderr)  # noqa: T201
        command = snakemake_command(path, options.cores, over=rest)
        if _run_workflow(command, options.json, is_told_here):
            raise SystemExit(status)
    elif status:  # the workflow has said why
        raise SystemExit(status)
    answer = _answer(path, rest) if options.json else None
    if is_told_here:
        _tell(path, options.study, rest)
    if status:
        if answer:
            print(json.dumps(answer, allow_nan=False))  # noqa: T201
        raise SystemExit(status)
    return answer


def _without_failures(path: Path) -> Path | None:
    """Return the configuration file that leaves out what failed, if the run wrote one."""
    failed = trusted(read_config(path)).failures_file
    return failed if failed.exists() else None


def _run_workflow(command: Sequence[str], keeps_output: bool, is_told_here: bool) -> int:
    """Run Snakemake, and return its exit status.

    keeps_output: for the answer alone. is_told_here: the closing lines are not Snakemake's.
    """
    output = sys.stderr if keeps_output else None
    environment = {**os.environ, **({TOLD_BY_CALLER: "yes"} if is_told_here else {})}
    with subprocess.Popen(command, stdout=output, env=environment) as workflow:
        try:
            return workflow.wait()
        except KeyboardInterrupt:
            workflow.wait()  # it has been interrupted as well, and ends its jobs
            raise


def _answer(path: Path, rest: Path | None) -> dict[str, Any]:
    """The rows of the closing table, what was left out, and where everything lies."""
    outputs = _outputs(path, rest)
    results = outputs.plan.results
    left_out = outputs.plan.left_out_rows()
    return {
        "results": summary_rows(results, outputs.titles, outputs.anchor),
        "left_out": [{"file": row["file"], "why": row["reason"]} for row in left_out],
        "report": str(results / REPORT),
        "configuration": str(path),
    }


def _tell(path: Path, study: str | None, rest: Path | None) -> None:
    """The table, also where nothing had to be made, and what can be done next."""
    outputs = _outputs(path, rest)
    results = outputs.plan.results
    for line in closing_lines(results, outputs.titles, outputs.anchor, since=0.0):
        print(line)  # noqa: T201
    for line in left_out_lines(outputs.plan.left_out_rows()):
        print(line)  # noqa: T201
    again = f"puckbench run {shlex.quote(str(path))}"
    print(f"to change the run, edit {path}, then: {again}")  # noqa: T201
    if study:
        beside = f"puckbench compare {shlex.quote(str(results))} --with {shlex.quote(study)}"
        print(f"to compare with the study: {beside}")  # noqa: T201


def _outputs(path: Path, rest: Path | None) -> OutputJobs:
    """Plan the tables and figures of a configuration, without what failed (`rest`)."""
    changes = read_config(rest) if rest else {}
    return Workflow({**read_config(path), **changes}, check_scenes=True).outputs


def _configuration(options: argparse.Namespace) -> tuple[Path, list[str]]:
    """The file of the configuration, given or made, and further words for Snakemake."""
    if options.study:
        return _of_study(options), []
    if options.datasets:
        raise InputError("--datasets: of a study alone (--study)")
    if not options.files:
        raise InputError("name files, a configuration, or a study (--study)")
    first, *others = options.files
    if Path(first).suffix.lower() in _CONFIGS:
        _refuse(options, _OF_CONFIG, f"the configuration says that: edit {first}")
        if not Path(first).is_file():
            raise InputError(f"{first}: no such file")
        read_config(Path(first))  # what is wrong with it is said before Snakemake reads it
        return Path(first), others
    return _of_files(options), []


def _refuse(options: argparse.Namespace, names: Iterable[str], why: str) -> None:
    """InputError where one of some options is given."""
    for name in _given(options, *names):
        raise InputError(f"--{name.replace('_', '-')}: {why}")


def _given(options: argparse.Namespace, *names: str) -> dict[str, Any]:
    """Those of some options that were given, if only a 0."""
    values = chosen(options, *names)
    return {
        name: value
        for name, value in values.items()
        if value not in (None, (), []) and value is not False
    }


def _of_study(options: argparse.Namespace) -> Path:
    """The configuration of one's own codecs on a study's clouds."""
    from puckbench.planning.study_run import study_configuration
    from puckbench.report.reference_results import read_reference

    others = [name for name in _OF_CONFIG if name not in ("codecs", "out")]
    _refuse(options, others, "the study says that: edit the configuration that is made")
    if options.files:
        raise InputError(f"{options.files[0]}: a study (--study) has clouds of its own")
    if not options.codecs:
        raise InputError(f"--codecs: name those to compare with {options.study}")
    study = read_reference(options.study)
    out = options.out or Path(_OUT)
    config = study_configuration(study, options.codecs, out.as_posix(), options.datasets or ())
    return _written(out, config)


def _of_files(options: argparse.Namespace) -> Path:
    """The configuration of a user's own files."""
    out = options.out or Path(_OUT)
    wanted = chosen(options, "frame", "limit", "scan", "strict")
    if options.errors and not options.scan:
        raise InputError("--errors: of scans alone (--scan)")
    wanted |= _given(options, "errors", "points", "peak")
    asked = OwnRun(
        timeout_s=options.timeout,
        paths=tuple(options.files),
        codecs=tuple(options.codecs or ()),
        results=out.as_posix(),
        rates=tuple(options.rates or ()),
        metrics=tuple(options.metrics or ()),
        options=_given(options, *_OF_LOADERS) | _units(options),
        **wanted,
    )
    return _written(out, asked.configuration())


def _units(options: argparse.Namespace) -> dict[str, Any]:
    words = options.metres_per_unit
    return {} if words is None else {"metres_per_unit": units(words)}


def _written(out: Path, config: dict[str, Any]) -> Path:
    """The file of a configuration that was made."""
    write_configuration(out / CONFIG, config, shlex.join(["puckbench", *sys.argv[1:]]))
    return out / CONFIG
