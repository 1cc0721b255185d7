"""An environment with everything that is installed here, except packages with plug-ins of ours."""

from __future__ import annotations

import sys
import sysconfig
import venv
from importlib.metadata import entry_points
from pathlib import Path

SOURCES = Path(__file__).parents[2] / "src"


def python_without_plugins(folder: Path) -> Path:
    """Make the environment in a folder, of links to what is installed; return its Python."""
    venv.create(folder, symlinks=True)
    names = {"base": str(folder), "platbase": str(folder)}
    site = Path(sysconfig.get_path("purelib", vars=names))
    added = {point.value for point in entry_points(group="puckbench.plugins")}
    packages = [path.parent for path in SOURCES.glob("*/__init__.py")]
    installed = [*Path(sysconfig.get_path("purelib")).iterdir()]
    for path in (*packages, *installed):
        name = path.name.partition("-")[0].removesuffix(".py")
        # Packages that are installed by a link to their sources have files named __editable__...
        if name not in added and not name.startswith("__") and not (site / path.name).exists():
            (site / path.name).symlink_to(path)
    return folder / "bin" / Path(sys.executable).name
