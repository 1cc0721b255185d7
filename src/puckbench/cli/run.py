from __future__ import annotations

import argparse
import json
import shlex
import sys
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Any

from pointkit.errors import InputError, among
from puckbench.cli.capture import STREAM
from puckbench.cli.types import integer, selected
from puckbench.cli.units import add_cloud_options, metres_per_unit
from puckbench.planning.config import read_config, trusted
from puckbench.planning.launch import run_workflow, snakemake_command
from puckbench.planning.outputs import Outputs
from puckbench.planning.run_summary import REPORT, closing_lines, summary_rows
from puckbench.planning.running import left_out_lines
from puckbench.planning.user_files import (
    CODECS,
    CODECS_OF_RECORDINGS,
    CONFIG,
    UserRun,
    write_configuration,
)
from puckbench.planning.workflow import Workflow

_OUT = "out"
_CONFIGS = (".yaml", ".yml")
_LOADER_OPTIONS = (
    *("metres_per_unit", "up", "drop_invalid", "keep_missing", "bin_columns", "topic", "stream"),
)
_CONFIG_OPTIONS = (
    *("codecs", "frame", "rates", "metrics", "scan", "errors", "points", "limit", "strict"),
    *("peak", "out", "timeout", "poses", *_LOADER_OPTIONS),
)
"""Options that stand for keys of a configuration."""


def arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    text = (
        "clouds (PLY, PCD, LAS, LAZ, E57, XYZ, CSV, TXT, NPY, NPZ, KITTI's .bin), meshes (OBJ, "
        "OFF, PLY, STL, GLB), recordings (.pcap, .bag, .mcap, ...), tables of capture (.parquet), "
        "folders or patterns; or one configuration (.yaml), and options of Snakemake after --"
    )
    add("files", nargs="*", help=text)
    defaults = f"default: {' '.join(CODECS)}; for recordings {' '.join(CODECS_OF_RECORDINGS)}"
    text = (
        "names (see `puckbench codecs`), or path/to/file.py:Class; the first is the anchor of the "
        f"BD-rates ({defaults})"
    )
    add("--codecs", nargs="+", metavar="CODEC", help=text)
    text = "code the clouds of a study with reference results (see `puckbench compare --help`)"
    add("--study", help=text)
    add("--datasets", nargs="+", metavar="NAME", help="data sets of the study (default: all)")
    add("--out", type=Path, help="folder of all results (default: out)")
    text = (
        "scaled: to a cube of 1024, with rates r1, r2, ...; metric: in metres, with rates 100mm, "
        "10mm, ... (default: metric for recordings, and if all clouds are LAS, LAZ, E57 or .bin)"
    )
    add("--frame", choices=("scaled", "metric"), help=text)
    text = "unit of the files (0.001: millimetres; default: 1), or of some: FILE=NUMBER ..."
    add("--metres-per-unit", nargs="+", metavar="NUMBER", help=text)
    text = "peak of the PSNRs of clouds in metres, in m (default: 30; papers on KITTI use 59.7)"
    add("--peak", type=float, help=text)
    text = (
        "names of rates, lengths such as 3mm, or all (default: all, or four if all would take long)"
    )
    add("--rates", nargs="+", metavar="RATE", help=text)
    text = "further metrics: density, or path/to/file.py:function"
    add("--metrics", nargs="+", metavar="METRIC", help=text)
    text = (
        "maximum number of clouds or meshes (default: all), or of turns of each recording "
        "(default: 10)"
    )
    add("--limit", type=integer(1), help=text)
    text = (
        "poses of the sensor (TUM, KITTI): consecutive turns, or frames of a folder, are also a "
        "drive on which odometry runs (at most 100 of them, or --limit)"
    )
    add("--poses", metavar="FILE", help=text)
    add("--topic", help="topic to read in ROS bags with several topics")
    add("--stream", help=STREAM)
    text = "scan meshes with a virtual VLP-16 instead of sampling them"
    add("--scan", action="store_true", help=text)
    text = "error model of the virtual sensor, with --scan (default: vlp16_divergence)"
    add("--errors", help=text)
    add("--points", type=integer(1), help="number of points sampled on a mesh (default: 100000)")
    add("--up", choices=("y", "z"), help="axis of meshes that points up (default: z)")
    add_cloud_options(parser)
    text = "stop if a file cannot be used, instead of leaving it out"
    add("--strict", action="store_true", help=text)
    add("--timeout", type=float, metavar="SECONDS", help="time after which a job fails")
    text = "code and measure all clouds with this codec again; may be given several times"
    add("--again", action="append", metavar="CODEC", default=[], help=text)
    add("--cores", type=integer(1), help="number of cores (default: all)")


def run(options: argparse.Namespace) -> dict[str, Any] | None:
    path, words = _configuration(options)
    status, rest = _run_all(path, options, words)
    answer = _answer(path, rest) if options.json else None
    if not (options.json or words):
        _print_summary(path, options.study, rest)
    if status:
        if answer:
            print(json.dumps(answer, allow_nan=False))  # noqa: T201
        raise SystemExit(status)
    return answer


def _run_all(path: Path, options: argparse.Namespace, words: list[str]) -> tuple[int, Path | None]:
    """Run the workflow; if jobs fail, run it again without them, so that a report is written.

    Returns the status of the first run and, if jobs failed, the file that lists them.
    """
    failed = trusted(read_config(path)).failures_file
    command, written, rest = snakemake_command(path, options.cores, *words), _time_of(failed), None
    status = last = run_workflow(
        command, quiet=options.json, goes_on=not words, again=options.again
    )
    while last == 1 and not words and _time_of(failed) not in (None, written):
        written, rest = _time_of(failed), failed
        print("puckbench: now tables and report of the others", file=sys.stderr)  # noqa: T201
        command = snakemake_command(path, options.cores, over=rest)
        last = run_workflow(command, quiet=options.json, goes_on=True)
    if last:  # the workflow has printed the reason
        raise SystemExit(status)
    return status, rest


def _time_of(path: Path) -> int | None:
    return path.stat().st_mtime_ns if path.exists() else None


def _answer(path: Path, rest: Path | None) -> dict[str, Any]:
    outputs = _outputs(path, rest)
    results = outputs.plan.results
    return {
        "results": summary_rows(results, outputs.titles, outputs.anchor),
        "left_out": [{"file": row["file"], "why": row["reason"]} for row in outputs.left_out_rows],
        "report": str(results / REPORT),
        "configuration": str(path),
    }


def _print_summary(path: Path, study: str | None, rest: Path | None) -> None:
    outputs = _outputs(path, rest)
    results = outputs.plan.results
    tables = (*outputs.gathered, *outputs.tables)
    for line in closing_lines(results, outputs.titles, outputs.anchor, 0.0, tables):
        print(line)  # noqa: T201
    for line in left_out_lines(outputs.left_out_rows):
        print(line)  # noqa: T201
    command = f"puckbench run {shlex.quote(str(path))}"
    print(f"to change the run, edit {path}, then: {command}")  # noqa: T201
    if study:
        command = f"puckbench compare {shlex.quote(str(results))} --with {shlex.quote(study)}"
        print(f"to compare with the study: {command}")  # noqa: T201


def _outputs(path: Path, rest: Path | None) -> Outputs:
    changes = read_config(rest) if rest else {}
    return Workflow({**read_config(path), **changes}, check_scenes=True).outputs


def _configuration(options: argparse.Namespace) -> tuple[Path, list[str]]:
    if options.study:
        return _study_configuration(options), []
    if options.datasets:
        raise InputError("--datasets: only with --study")
    if not options.files:
        raise InputError("give files, a configuration, or a study (--study)")
    first, *others = options.files
    if Path(first).suffix.lower() in _CONFIGS:
        _refuse(options, _CONFIG_OPTIONS, f"the configuration has a key for this: edit {first}")
        if not Path(first).exists():
            raise InputError(f"{first}: no such file")
        config = read_config(Path(first))  # for one-line errors, which Snakemake does not have
        if options.again:
            _check_again(options, trusted(config).codecs)
        return Path(first), others
    return _files_configuration(options), []


def _check_again(options: argparse.Namespace, codecs: Collection[str]) -> None:
    for name in options.again:
        if name not in codecs:
            raise InputError(f"--again: no codec '{name}'{among(name, codecs)}")


def _refuse(options: argparse.Namespace, names: Iterable[str], why: str) -> None:
    for name in _set_options(options, *names):
        raise InputError(f"--{name.replace('_', '-')}: {why}")


def _set_options(options: argparse.Namespace, *names: str) -> dict[str, Any]:
    return {
        name: value
        for name, value in selected(options, *names).items()
        if value not in (None, (), []) and value is not False  # 0 is given
    }


def _study_configuration(options: argparse.Namespace) -> Path:
    from puckbench.planning.study_run import study_configuration
    from puckbench.report.reference_results import read_reference

    others = [name for name in _CONFIG_OPTIONS if name not in ("codecs", "out")]
    _refuse(options, others, "the study sets this: edit the configuration that is written")
    if options.files:
        raise InputError(f"{options.files[0]}: with --study only the study's clouds are coded")
    if not options.codecs:
        raise InputError(f"--codecs: give the codecs to compare with {options.study}")
    study = read_reference(options.study)
    out = options.out or Path(_OUT)
    config = study_configuration(study, options.codecs, out.as_posix(), options.datasets or ())
    return _written(options, out, config)


def _files_configuration(options: argparse.Namespace) -> Path:
    out = options.out or Path(_OUT)
    settings = selected(options, "frame", "limit", "scan", "strict")
    if options.errors and not options.scan:
        raise InputError("--errors: only with --scan")
    settings |= _set_options(options, "errors", "points", "peak")
    user_run = UserRun(
        timeout_s=options.timeout,
        paths=tuple(options.files),
        codecs=tuple(options.codecs or ()),
        results=out.as_posix(),
        rates=tuple(options.rates or ()),
        metrics=tuple(options.metrics or ()),
        poses=options.poses,
        options=_set_options(options, *_LOADER_OPTIONS[1:]) | _units(options),
        **settings,
    )
    return _written(options, out, user_run.configuration())


def _units(options: argparse.Namespace) -> dict[str, Any]:
    words = options.metres_per_unit
    return {} if words is None else {"metres_per_unit": metres_per_unit(words)}


def _written(options: argparse.Namespace, out: Path, config: dict[str, Any]) -> Path:
    _check_again(options, config["codecs"])
    write_configuration(out / CONFIG, config, shlex.join(["puckbench", *sys.argv[1:]]))
    return out / CONFIG
