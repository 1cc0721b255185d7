from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

from pointkit.errors import InputError

_WORKFLOW = Path(__file__).parents[1] / "workflow"
"""Folder of the workflow; in a repository, a link to it."""

CALLER_GOES_ON = "PUCKBENCH_CALLER_GOES_ON"
"""Environment variable that is set if the process that starts Snakemake goes on after it.

This process then prints the summary and, after failures, starts Snakemake again for what can still
be made.
"""
AGAIN = "PUCKBENCH_AGAIN"
"""Environment variable with the names of codecs whose curves are made again in any case."""


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
