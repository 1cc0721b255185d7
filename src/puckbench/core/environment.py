"""The run environment of a timed call: processor, threads, versions of the libraries."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

from puckbench.core.loop_cache import loops_folder

THREAD_VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMEXPR_NUM_THREADS",
    "NUMBA_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
)
"""Environment variables by which OpenMP (PyTorch, pykdtree), BLAS and numba limit their threads."""

LIBRARIES = ("numpy", "scipy", "numba", "DracoPy", "torch", "constriction", "pykdtree")
"""Packages that codecs and metrics run in; those that are not installed are left out."""

INSTALLED = (
    *LIBRARIES,
    "open3d-cpu",
    "open3d",
    "imagecodecs",
    "pyarrow",
    "pandas",
    "matplotlib",
    "pydantic",
    "snakemake",
)
"""Packages whose versions a report of a fault should name; those not installed are left out."""


def thread_environment(threads: int) -> dict[str, str]:
    """Additions to the environment of a program that may use `threads` threads."""
    return dict.fromkeys(THREAD_VARIABLES, str(threads))


def run_environment(alone: bool) -> dict[str, Any]:
    """Columns of a result row: ``cpu``, ``threads``, ``timed_alone`` and ``libraries``.

    Parameters
    ----------
    alone
        Whether no other job of the run ran meanwhile, which only the caller knows.
    """
    return {
        "cpu": cpu_model(),
        "threads": allowed_threads(),
        "timed_alone": alone,
        "libraries": libraries(),
    }


def allowed_threads() -> int:
    """Threads that libraries may use: ``OMP_NUM_THREADS``, else the cores of the process."""
    limit = os.environ.get("OMP_NUM_THREADS", "").split(",")[0]
    return int(limit) if limit.isdigit() else _cores()


def _cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@cache
def cpu_model() -> str:
    """The processor's name, or its architecture where the system gives no name."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    named = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return (named or [platform.processor() or platform.machine()])[0]


COMMIT = "PUCKBENCH_COMMIT"


def source_commit() -> str:
    """The commit of the sources that run, with "-dirty" where files differ from it; else empty.

    Known only where this package runs from a repository of its own, and git is there. A run asks
    once, and hands it to its jobs as `COMMIT` in their environment.
    """
    if COMMIT in os.environ:
        return os.environ[COMMIT]
    root = Path(__file__).parents[3]
    if not (root / ".git").exists() or not shutil.which("git"):
        return ""
    words = [
        "git",
        "-C",
        str(root),
        "describe",
        "--always",
        "--dirty",
        "--abbrev=12",
        "--exclude=*",
    ]
    environment = {**os.environ, "GIT_OPTIONAL_LOCKS": "0"}  # runs may ask at the same time
    done = subprocess.run(words, capture_output=True, text=True, env=environment, check=False)
    return done.stdout.strip() if done.returncode == 0 else ""


@cache
def libraries() -> str:
    """Python's and the packages' versions in one line, "python 3.11.7; numpy 2.1.3; ..."."""
    versions = {"python": platform.python_version()}
    versions |= {name: version for name in LIBRARIES if (version := _version(name))}
    return "; ".join(f"{name} {version}" for name, version in versions.items())


def _version(package: str) -> str:
    """The version of an installed package; empty where it is not installed."""
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return ""


def installation() -> dict[str, str]:
    """What a report of a fault should say: system, processor, places and the packages' versions."""
    sources = Path(__file__).parents[1]
    return {
        "commit": source_commit() or "unknown (not run from a repository)",
        "sources": str(sources),
        "python": f"{platform.python_version()}, {sys.executable}",
        "system": platform.platform(),
        "processor": cpu_model(),
        "threads": str(allowed_threads()),
        "compiled loops": str(loops_folder(sources)),
        **{name: version for name in INSTALLED if (version := _version(name))},
    }
