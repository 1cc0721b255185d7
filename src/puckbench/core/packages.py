"""Packages of the repository, and others with plug-ins, which jobs import."""

from __future__ import annotations

import os
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path

ENGINES = (
    *("cloud_files", "gpcc", "pcc_networks", "pointkit", "primitive_codec", "puck"),
    "virtual_lidar",
)


def plugin_packages() -> list[EntryPoint]:
    """Return the packages that add plug-ins of several kinds (`pointkit.registry`)."""
    return list(entry_points(group="puckbench.plugins"))


def package_folders() -> dict[str, Path]:
    """Return the folders of puckbench, its engines and the packages with plug-ins, by name.

    Packages that are not installed are left out.
    """
    names = ("puckbench", *ENGINES, *(point.value for point in plugin_packages()))
    specs = {name: find_spec(name) for name in names}
    return {name: Path(spec.origin).parent for name, spec in specs.items() if spec and spec.origin}


def packages_alone(folder: Path) -> Path:
    """Make a folder with links to these packages only, for jobs to import; return its path.

    The folder also declares the packages with plug-ins, as their installation does.
    """
    folder = folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    for name, package in package_folders().items():
        link = folder / name
        if not link.is_symlink() or link.readlink() != package:
            new = link.with_name(f"{name}.{os.getpid()}")
            new.symlink_to(package)
            new.replace(link)  # atomic, since several jobs may do it at the same time
    for point in plugin_packages():
        if point.dist is not None:
            about = folder / f"{point.value}.dist-info"
            about.mkdir(exist_ok=True)
            for part in ("METADATA", "entry_points.txt"):
                (about / part).write_text(point.dist.read_text(part) or "")
    return folder
