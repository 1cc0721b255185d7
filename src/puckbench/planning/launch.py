from __future__ import annotations

import argparse
import csv
import os
import shlex
import subprocess
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

from pointkit.errors import InputError
from puckbench.core.interrupts import run_environment
from puckbench.planning.failures import PREFIX

_WORKFLOW = Path(__file__).parents[1] / "workflow"
"""Folder of the workflow; in a repository, a link to it."""

CALLER_GOES_ON = "PUCKBENCH_CALLER_GOES_ON"
"""Environment variable that is set if the process that starts Snakemake goes on after it.

This process then prints the summary and, after failures, starts Snakemake again for what can still
be made.
"""
AGAIN = "PUCKBENCH_AGAIN"
"""Environment variable with the names of codecs whose curves are made again in any case."""
_UP_TO_DATE = "no update"
"""What Snakemake's summary plans for results that are up to date."""


def snakefile() -> Path:
    """Return the path of the workflow's ``Snakefile``; raise InputError if it is missing."""
    if (file := _WORKFLOW.resolve() / "Snakefile").is_file():
        return file
    raise InputError("the workflow is not in this installation of puckbench; install its wheel")


def snakemake_command(
    config: Path, cores: int | None, *more: str, over: Path | None = None
) -> list[str]:
    """Return the command that runs the workflow, as a list of words.

    Parameters
    ----------
    config
        Configuration file.
    cores
        Maximum number of cores; None uses all.
    more
        Further arguments of Snakemake.
    over
        Second configuration file, whose values replace those of the first.
    """
    words = [sys.executable, "-m", "snakemake", *more]
    words += [] if "--logger" in more else ["--logger", "puckbench"]
    words += ["--snakefile", str(snakefile()), "--cores", "all" if cores is None else str(cores)]
    return [*words, "--configfile", str(config), *([str(over)] if over else [])]


def run_workflow(
    command: Sequence[str],
    *,
    quiet: bool,
    goes_on: bool,
    again: Sequence[str] = (),
    python_path: Sequence[Path] = (),
    folder: Path | None = None,
) -> int:
    """Run the workflow, and return its exit status; it ends when this process is interrupted.

    Parameters
    ----------
    command
        The command, as from `snakemake_command`.
    quiet
        Whether to keep standard output free: the workflow writes to standard error only.
    goes_on
        Whether this process goes on after the workflow (`CALLER_GOES_ON`).
    again
        Names of codecs whose curves are made again in any case (`AGAIN`).
    python_path
        Folders in which Python searches for modules first.
    folder
        Working folder; by default that of this process.
    """
    output = sys.stderr if quiet else None
    stdin, held = os.pipe()
    environment = run_environment(stdin)
    if python_path:
        paths = [*map(str, python_path), *filter(None, [environment.get("PYTHONPATH")])]
        environment["PYTHONPATH"] = os.pathsep.join(paths)
    environment |= {AGAIN: " ".join(again), **({CALLER_GOES_ON: "yes"} if goes_on else {})}
    with subprocess.Popen(
        command, stdin=stdin, stdout=output, env=environment, cwd=folder
    ) as workflow:
        os.close(stdin)
        try:
            return workflow.wait()
        except KeyboardInterrupt:
            os.close(held)  # which interrupts the workflow and its jobs
            workflow.wait()
            raise


def outdated_files(config: Path) -> list[str]:
    """Return the results of a configuration that a run would make now, as paths.

    They are missing, or were made from other inputs, with other settings, or by other code.

    Raises
    ------
    InputError
        The run cannot be planned.
    """
    command = snakemake_command(config, None, "--summary")
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        lines = [line for line in done.stderr.splitlines() if line.startswith(PREFIX)]
        fault = (lines or done.stderr.splitlines() or ["no reason was given"])[-1]
        raise InputError(f"{config}: the run cannot be planned: {fault.removeprefix(PREFIX)}")
    rows = csv.DictReader(done.stdout.splitlines(), delimiter="\t")
    return [row["output_file"] for row in rows if row["plan"] != _UP_TO_DATE]


def command_for_the_rest(words: Sequence[str], files: Iterable[Path], start: Path | None) -> str:
    """Return the command by which a user can make what is left after failures.

    It is the command of the present run, with other configuration files.

    Parameters
    ----------
    words
        Arguments of Snakemake in the present run.
    files
        Configuration files of the new command.
    start
        Folder in which the user started the present run. Paths below it are written relative to it;
        with None, all paths are absolute.

    Returns
    -------
    str
        One line, quoted for a shell.
    """
    end = words.index("--") if "--" in words else len(words)
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--configfile", "--configfiles", nargs="+")
    others = parser.parse_known_args(words[:end])[1]
    paths = [path.absolute() for path in files]
    if start is not None:
        paths = [path.relative_to(start) if path.is_relative_to(start) else path for path in paths]
    configs = ["--configfile", *map(str, dict.fromkeys(paths))]
    return shlex.join(["snakemake", *others, *configs, *words[end:]])
