"""What the page was made with and on: versions of programs and libraries, processor."""

from __future__ import annotations

import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from puckbench import __version__

_PACKAGES = ("numpy", "scipy", "pandas", "numba", "open3d", "open3d-cpu", "DracoPy", "torch")


def machine() -> dict[str, str]:
    """Facts of this machine by name, those that can be known."""
    found = {name: _version(name) for name in _PACKAGES}
    libraries = ", ".join(f"{name} {number}" for name, number in found.items() if number)
    facts = {
        "puckbench": __version__,
        "Python": f"{platform.python_implementation()} {platform.python_version()}",
        "Libraries": libraries,
        "System": f"{platform.system()} {platform.machine()}",
        "Processor": f"{_processor()} ({os.cpu_count()} logical cores)",
    }
    return {name: text for name, text in facts.items() if text}


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return ""


def _processor(cpuinfo: Path = Path("/proc/cpuinfo")) -> str:
    """The processor's model name; the architecture where the system does not tell it."""
    try:
        lines = cpuinfo.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    named = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(named, platform.processor() or platform.machine())
