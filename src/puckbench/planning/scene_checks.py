"""Checks of scenes before a run: damaged meshes, no position for a sensor, clouds without points.

Results are cached in the results folder until files or settings change.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from puckbench.core.errors import InputError
from puckbench.core.files import read_object, write_json
from puckbench.core.models import Model, parsed
from puckbench.core.progress import Progress
from puckbench.datasets.scene import Scene, SceneSet, read_first
from puckbench.geometry.cloud import Floats, PointCloud, bounds, check_extent
from puckbench.geometry.extent import warn_of_implausible_extent
from puckbench.geometry.scaling import origin_shift
from puckbench.io.point_columns import WIDE_COLOURS
from puckbench.jobs.scan import Scan
from puckbench.planning.config import DataSetConfig, DriveConfig
from puckbench.planning.planned_job import planned


def scan_record(settings: DataSetConfig, scene: str, seed: int) -> Scan:
    return Scan(**scan_settings(settings, scene, seed))


def scan_settings(settings: DataSetConfig | DriveConfig, scene: str, seed: int) -> dict[str, Any]:
    return {
        "sensor": settings.sensor,
        "errors": settings.errors,
        "error_options": settings.error_options,
        "sweep": settings.sweep,
        "origin": settings.origin_in(scene),
        "height_m": settings.height_m,
        "anywhere": settings.anywhere,
        "seed": seed,
    }


def scene_faults(
    scenes: SceneSet, names: Iterable[str], settings: DataSetConfig, results_file: Path
) -> dict[str, str]:
    """Return the scenes that a data set cannot use, with reasons; `results_file` is the cache."""
    if settings.make == "cloud" and not read_first(scenes):
        return {}
    states = {
        name: _state(scenes, files, settings, name)
        for name in names
        if (files := scenes.files(name))
    }
    results = _read_checks(results_file) if states else {}
    stale = [name for name, state in states.items() if results.get(name, {}).get("state") != state]
    what = "meshes"
    # Read faulty clouds again: a package that reads their format may have been installed.
    if settings.make == "cloud":
        what, faulty = "clouds", {name for name in states if results.get(name, {}).get("fault")}
        stale = [name for name in states if name in faulty or name in stale]
    progress = Progress(f"{results_file.stem}: {what} looked at:")
    for done, name in enumerate(stale, start=1):
        fault, measured = _check_scene(scenes, name, settings)
        results[name] = {"state": states[name], "fault": fault, **measured}
        progress(done, len(stale))
    if stale:
        write_json(results_file, results)
    return {name: results[name]["fault"] for name in states if results[name]["fault"]}


def most_points(results_file: Path, scenes: Iterable[str]) -> int | None:
    checks = _read_checks(results_file)
    return max(
        (checks[name]["points"] for name in scenes if "points" in checks.get(name, {})),
        default=None,
    )


class _Check(Model):
    state: str
    fault: str | None
    points: int | None = None
    extent_m: float | None = None
    attributes: tuple[str, ...] = ()
    is_shifted: bool = False
    dropped_points: int = 0


def _read_checks(results_file: Path) -> dict[str, dict[str, Any]]:
    checks = read_object(results_file) if results_file.exists() else {}
    for name, check in checks.items():
        parsed(_Check, check, f"{results_file}: {name}")
    return checks


def extents(results_file: Path, scenes: Iterable[str]) -> dict[str, float]:
    """Return the longest sides of the scenes' bounding boxes, m."""
    checks = _read_checks(results_file)
    return {name: checks[name]["extent_m"] for name in scenes if "extent_m" in checks.get(name, {})}


def attributes(results_file: Path, scenes: Iterable[str]) -> list[str]:
    """Return the names of the attributes, besides coordinates, of the points in the scenes."""
    checks = _read_checks(results_file)
    names = (name for scene in scenes for name in checks.get(scene, {}).get("attributes", ()))
    return list(dict.fromkeys(names))


def are_shifted(results_file: Path, scenes: Iterable[str]) -> bool:
    """Whether a scene is far from the origin, so that its cloud in metres is shifted."""
    checks = _read_checks(results_file)
    return any(checks.get(scene, {}).get("is_shifted") for scene in scenes)


def dropped_points(results_file: Path, scenes: Iterable[str]) -> int:
    """Return the number of points that the scenes' files have and their clouds do not."""
    checks = _read_checks(results_file)
    return sum(checks.get(scene, {}).get("dropped_points", 0) for scene in scenes)


def _state(scenes: SceneSet, files: Iterable[Path], settings: DataSetConfig, name: str) -> str:
    options = scenes.model_dump_json(exclude={"path"}) if isinstance(scenes, Model) else ""
    job: tuple[object, ...] = (settings.make, settings.is_metric, options, "dropped points")
    if settings.is_scan:
        job += (planned(scan_record(settings, name, seed=0)),)
    stats = [stat for path in files for stat in _stats(path)]
    return hashlib.sha256(repr((job, stats)).encode()).hexdigest()[:16]


def _stats(path: Path) -> Iterator[tuple[str, int, int]]:
    try:
        for each in sorted(path.iterdir()) if path.is_dir() else [path]:
            stat = each.stat()
            yield str(each), stat.st_size, stat.st_mtime_ns
    except OSError:
        yield str(path), 0, 0


def _check_scene(
    scenes: SceneSet, name: str, settings: DataSetConfig
) -> tuple[str | None, dict[str, Any]]:
    from puckbench.geometry.mesh import check_mesh

    try:
        scene = scenes.load(name)
        if isinstance(scenes, Model) and "metres_per_unit" in type(scenes).model_fields:
            _remark_extent(scenes, scene, settings)
        cloud = scene.cloud
        points = scene.returns.points() if scene.returns else None if cloud is None else cloud.xyz
        if points is not None and settings.make == "cloud":
            return None, {
                "points": len(points),
                "extent_m": _extent(points),
                "is_shifted": bool(origin_shift(points).any()),
                "attributes": [] if cloud is None else _attributes(cloud),
                "dropped_points": scene.about.get("dropped_points", 0),
            }
        if scene.mesh is None:
            how = f"make: cloud, not {settings.make}"
            return f"it holds points, which are taken as they are ({how})", {}
        what = str(next(iter(scenes.files(name)), "its mesh"))
        check_mesh(scene.mesh, what)
        corners = scene.mesh.vertices[scene.mesh.triangles].reshape(-1, 3)
        check_extent(corners, what)
        if settings.is_scan:
            scan_record(settings, name, seed=0).check(scene.mesh, scene.origin)
            return None, {}
    except InputError as error:
        return " ".join(str(error).split()), {}
    return None, {"extent_m": _extent(corners)}


def _attributes(cloud: PointCloud) -> list[str]:
    arrays = {"normals": cloud.normals, "colours": cloud.colours, "labels": cloud.labels}
    names = [name for name, values in {**arrays, **cloud.fields}.items() if values is not None]
    return [name for name in names if name not in WIDE_COLOURS]  # they repeat the colours


def _extent(points: Floats) -> float:
    low, high = bounds(points)
    return float((high - low).max())


def _remark_extent(scenes: SceneSet, scene: Scene, settings: DataSetConfig) -> None:
    path = scenes.files(scene.name)[0]
    if scene.mesh is not None and settings.is_scan:
        warn_of_implausible_extent(path, scene.mesh.bounds())
    if scene.cloud is not None and settings.is_metric:
        warn_of_implausible_extent(path, bounds(scene.cloud.xyz))
