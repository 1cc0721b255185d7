"""Old import paths: importing a module that has moved fails with a line that names the new one."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.machinery import ModuleSpec
from types import ModuleType

_MOVED = {
    "puckbench.codecs.facts": "puckbench.codecs.base, puckbench.codecs.rates or .registry",
    "puckbench.coding": "pointkit.coding or puckbench.codecs",
    "puckbench.core.compiling": "pointkit.compiling",
    "puckbench.core.content": "cloud_files.content",
    "puckbench.core.errors": "pointkit.errors",
    "puckbench.core.files": "pointkit.files",
    "puckbench.core.lazy": "pointkit.lazy",
    "puckbench.core.measurement": "pointkit.measurement",
    "puckbench.core.models": "pointkit.models",
    "puckbench.core.progress": "pointkit.terminal",
    "puckbench.core.registry": "pointkit.registry",
    "puckbench.core.seeding": "pointkit.seeding",
    "puckbench.core.threads": "pointkit.threads",
    "puckbench.core.yaml_files": "pointkit.yaml_files",
    "puckbench.datasets": "puckbench.scene_sets, where DataSet is SceneSet",
    "puckbench.figures.plotted_metrics": "puckbench.results.columns",
    "puckbench.geometry": "pointkit.geometry",
    "puckbench.geometry.bounded_search": "primitive_codec.bounded_search",
    "puckbench.geometry.missing_returns": "cloud_files.missing_returns",
    "puckbench.geometry.vectors": "primitive_codec.vectors",
    "puckbench.gpcc": "gpcc",
    "puckbench.io": "cloud_files, pointkit, puck.recordings or puckbench.core.archives",
    "puckbench.jobs.curve_files": "puckbench.results.curves or puckbench.results.row_files",
    "puckbench.jobs.table_files": "puckbench.tables.files",
    "puckbench.jobs.tables": "puckbench.tables or puckbench.results",
    "puckbench.jobs": "puckbench.steps, puckbench.results or puckbench.cli",
    "puckbench.learned": "pcc_networks",
    "puckbench.lidar": "virtual_lidar, pointkit.lidar, puck.recordings or puckbench.recordings",
    "puckbench.metrics.table_registry": "puckbench.tables.registry",
    "puckbench.metrics.tables": "puckbench.tables",
    "puckbench.primitives": "primitive_codec",
    "puckbench.puck": "puck",
    "puckbench.report.cells": "puckbench.tables.cells",
    "puckbench.report.claims": "jenco2022.sections",
    "puckbench.report.column_dictionary": "puckbench.tables.column_dictionary",
    "puckbench.report.column_labels": "puckbench.results.columns",
    "puckbench.report.latex": "puckbench.tables.latex",
    "puckbench.scenes": "virtual_lidar.scenes",
    "puckbench.storage": "puckbench.codecs.storage",
    "puckbench.thesis": "jenco2022 or puckbench.figures",
}
"""Old modules and packages, and where they, or most of what was in them, are now."""


class MovedModules:
    """Explains the import of a module that no other finder has found."""

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        place = name
        while place and place not in _MOVED:
            place = place.rpartition(".")[0]
        if not place:
            return None
        # Not ModuleNotFoundError, which `from puckbench import gpcc` would replace by its own.
        raise ImportError(f"{name} has moved: import it from {_MOVED[place]}", name=name)
