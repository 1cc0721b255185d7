"""Packages that jobs import: those of this repository, and installed packages with plug-ins."""

from __future__ import annotations

import os
from importlib.util import find_spec
from pathlib import Path

from pointkit.registry import plugin_packages

ENGINES = (
    *("cloud_files", "gpcc", "lidar_segmentation", "pcc_networks", "pointkit"),
    *("primitive_codec", "puck", "virtual_lidar"),
)
"""Packages of this repository that puckbench builds on."""


def package_folders() -> dict[str, Path]:
    """Return the folders of the packages that jobs import, by the package's name.

    These are puckbench, `ENGINES`, and the packages with plug-ins. Packages that are not installed
    are left out.
    """
    names = ("puckbench", *ENGINES, *plugin_packages())
    specs = {name: find_spec(name) for name in names}
    return {name: Path(spec.origin).parent for name, spec in specs.items() if spec and spec.origin}


def packages_alone(folder: Path) -> Path:
    """Make a folder from which jobs can import the packages of `package_folders` and no others.

    The folder contains links to the packages. It also declares the packages with plug-ins, as their
    installation does.

    Parameters
    ----------
    folder
        The folder; it is made if it does not exist.

    Returns
    -------
    Path
        Absolute path of the folder.
    """
    folder = folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    for name, package in package_folders().items():
        link = folder / name
        if not link.is_symlink() or link.readlink() != package:
            new = link.with_name(f"{name}.{os.getpid()}")
            new.symlink_to(package)
            new.replace(link)  # atomic, since several jobs may do it at the same time
    for name, point in plugin_packages().items():
        if point.dist is not None:
            about = folder / f"{name}.dist-info"
            about.mkdir(exist_ok=True)
            for part in ("METADATA", "entry_points.txt"):
                (about / part).write_text(point.dist.read_text(part) or "")
    return folder
