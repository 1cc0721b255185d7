from __future__ import annotations

import sys
from pathlib import Path

from puckbench.core.errors import InputError

_PACKAGE = Path(__file__).parents[1]
_PLACES = (_PACKAGE.parents[1] / "workflow", _PACKAGE / "workflow")
"""Folders of the workflow in a repository and in a wheel (see setup.py)."""

CALLER_PRINTS_SUMMARY = "PUCKBENCH_CALLER_PRINTS_SUMMARY"
"""Environment variable that is set if the caller of Snakemake prints the summary."""


def snakefile() -> Path:
    for folder in _PLACES:
        if (folder / "rules").is_dir() and (file := folder / "Snakefile").is_file():
            return file
    raise InputError("the workflow is not in this installation of puckbench; install its wheel")


def snakemake_command(
    config: Path, cores: int | None, *more: str, over: Path | None = None
) -> list[str]:
    words = [sys.executable, "-m", "snakemake", *more]
    words += [] if "--logger" in more else ["--logger", "puckbench"]
    words += ["--snakefile", str(snakefile()), "--cores", "all" if cores is None else str(cores)]
    return [*words, "--configfile", str(config), *([str(over)] if over else [])]
