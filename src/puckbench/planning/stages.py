from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from puckbench.planning.workflow import Workflow


@dataclass(frozen=True)
class Stage:
    """The files, relative to `folder` and without `suffix`, that a step of a run makes."""

    folder: Path
    suffix: str
    planned: frozenset[str]

    @cached_property
    def existing(self) -> Mapping[str, float]:
        """Planned files that exist already, with their modification times in seconds."""
        start, end = len(str(self.folder)) + 1, -len(self.suffix)
        times = {
            path[start:end]: time
            for path, time in _files(self.folder)
            if path.endswith(self.suffix)
        }
        return {name: time for name, time in times.items() if name in self.planned}

    @property
    def is_complete(self) -> bool:
        return len(self.existing) == len(self.planned)


def _files(folder: Path) -> Iterator[tuple[str, float]]:
    try:
        entries = sorted(os.scandir(folder), key=lambda entry: entry.name)
    except FileNotFoundError:
        return
    for entry in entries:
        if entry.is_dir():
            yield from _files(Path(entry.path))
        else:
            yield entry.path, entry.stat().st_mtime


def stages_of(bench: Workflow) -> dict[str, Stage]:
    plan, root = bench.plan, bench.plan.results
    curves = frozenset(map("/".join, plan.curves))
    clouds = frozenset(map("/".join, plan.clouds))
    scenes = frozenset(
        f"{data.scenes}/{scene}" for data in plan.datasets.values() for scene in data.used_scenes
    )
    return {
        "scenes": Stage(root / "scenes", ".ply", scenes),
        "samples": Stage(root / "samples", ".ply", _clouds_by(bench, "sample")),
        "scans": Stage(root / "scans", ".parquet", _clouds_by(bench, "scan")),
        "clouds": Stage(root / "clouds", ".ply", clouds),
        "about": Stage(root / "clouds", ".json", clouds),
        "coded": Stage(root / "coded", ".zip", curves),
        "metrics": Stage(root / "metrics", ".parquet", curves),
        "figures": Stage(root / "figures", ".pdf", frozenset(bench.outputs.figures)),
        "tables": Stage(root / "tables", ".csv", frozenset(bench.outputs.tables)),
    }


def _clouds_by(bench: Workflow, make: str) -> frozenset[str]:
    datasets = [data for data in bench.plan.datasets.values() if data.settings.make == make]
    return frozenset(f"{data.name}/{cloud}" for data in datasets for cloud in data.clouds)
