from __future__ import annotations

import importlib.metadata
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

from pointkit.sources import loops_folder
from pointkit.threads import allowed_threads

THREAD_VARIABLES = (
    *("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"),
    *("NUMEXPR_NUM_THREADS", "NUMBA_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"),
)
"""Environment variables that limit the threads of OpenMP (PyTorch, pykdtree), BLAS and numba."""

LIBRARIES = ("numpy", "scipy", "numba", "DracoPy", "torch", "constriction", "pykdtree")
"""Packages whose versions affect the times of codecs and metrics."""

PACKAGES = (
    *(*LIBRARIES, "open3d-cpu", "open3d", "imagecodecs", "pyarrow"),
    *("pandas", "matplotlib", "pydantic", "snakemake"),
)
"""Packages whose versions the report states."""

COMMIT = "PUCKBENCH_COMMIT"
"""Environment variable by which a run tells its jobs the commit of the sources."""


def thread_environment(threads: int) -> dict[str, str]:
    """Return environment variables that limit numerical libraries to a number of threads."""
    return dict.fromkeys(THREAD_VARIABLES, str(threads))


def run_environment(alone: bool) -> dict[str, Any]:
    """Return facts about this machine that belong to measured times, by column of results.

    `alone` tells whether no other job ran at the same time.
    """
    return {
        "cpu": cpu_model(),
        "threads": allowed_threads(),
        "timed_alone": alone,
        "libraries": libraries(),
    }


@cache
def cpu_model() -> str:
    """Return the name of the processor's model or, if it is unknown, the architecture."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return (names or [platform.processor() or platform.machine()])[0]


@cache
def libraries() -> str:
    """Return the versions of Python and of `LIBRARIES`, as ``python 3.11.7; numpy 2.1.3; ...``."""
    versions = {"python": platform.python_version(), **installed_versions(LIBRARIES)}
    return "; ".join(f"{name} {version}" for name, version in versions.items())


def installed_versions(packages: Iterable[str] = PACKAGES) -> dict[str, str]:
    """Return the versions of those of some packages that are installed, by package name."""
    versions = {}
    for name in packages:
        try:
            versions[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return versions


def source_commit() -> str:
    """Return the abbreviated hash of the Git commit of the sources.

    It ends in ``-dirty`` if tracked files were changed since. It is empty if the sources are not in
    a Git repository.
    """
    if COMMIT in os.environ:
        return os.environ[COMMIT]
    root = Path(__file__).parents[3]
    if not (root / ".git").exists() or not shutil.which("git"):
        return ""
    options = ("--always", "--dirty", "--abbrev=12", "--exclude=*")
    done = subprocess.run(
        ["git", "-C", str(root), "describe", *options],
        capture_output=True,
        text=True,
        env={**os.environ, "GIT_OPTIONAL_LOCKS": "0"},  # several runs may ask at the same time
        check=False,
    )
    return done.stdout.strip() if done.returncode == 0 else ""


def installation() -> dict[str, str]:
    """Return facts about this installation for a bug report, as text by name.

    They are the commit and folder of the sources, the processor, and the versions of packages.
    """
    sources = Path(__file__).parents[1]
    return {
        "commit": source_commit() or "unknown (not run from a repository)",
        "sources": str(sources),
        "python": f"{platform.python_version()}, {sys.executable}",
        "system": platform.platform(),
        "processor": cpu_model(),
        "threads": str(allowed_threads()),
        "compiled loops": str(loops_folder(sources)),
        **installed_versions(),
    }
