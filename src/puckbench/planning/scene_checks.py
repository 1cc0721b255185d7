"""Checks, before a run, whether scenes can be used.

A scene cannot be used if its mesh is damaged, if there is no position for the sensor in it, or if
its cloud has no points. Results are stored in the results folder until files or settings change.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from cloud_files.point_columns import WIDE_COLOURS
from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats, PointCloud, bounds, check_extent
from pointkit.models import Model, parsed
from pointkit.terminal import Progress
from puckbench.geometry.extent import warn_of_implausible_extent
from puckbench.geometry.scaling import origin_shift
from puckbench.planning.config import DataSetConfig
from puckbench.planning.memory import Memory
from puckbench.scene_sets.base import SceneSet
from puckbench.scene_sets.scene import Scene
from puckbench.scene_sets.user_files import FileSet
from puckbench.steps.scan import Scan
from puckbench.steps.step import planned

_PATTERN = re.compile(r"\{\s*[.\w]+\s*(,[^{}]*)?\}|<[a-z][a-z0-9_]*>")
"""Wildcards and path variables of Snakemake, which has no way to escape them."""

_UNPRINTABLE = re.compile(r"[\r\n\ud800-\udfff]")


def scene_faults(
    scenes: SceneSet,
    names: Iterable[str],
    settings: DataSetConfig,
    memory: Memory,
    place: str,
    digest_of: Callable[[Iterable[Path]], str],
) -> dict[str, str]:
    """Return the names of the scenes that a data set cannot use, each with the reason.

    Parameters
    ----------
    scenes
        The opened scene set.
    names
        Names of the scenes to check.
    settings
        The data set's entry in the configuration.
    memory, place
        Where the results of checks are stored, and under which name. A scene is read again only if
        its files or the settings changed, or if it is a cloud that could not be used.
    digest_of
        Function that returns a digest of the content of files.
    """
    files_of = {name: files for name in names if (files := scenes.files(name))}
    unnamed = {
        name: fault
        for name, files in files_of.items()
        for fault in filter(None, map(path_fault, files))
    }
    if settings.make == "cloud" and not scenes.read_first:
        return unnamed
    states = {
        name: _state(scenes, digest_of(files), settings, name)
        for name, files in files_of.items()
        if name not in unnamed
    }
    results = read_checks(memory, place) if states else {}
    is_cloud = settings.make == "cloud"
    # Read faulty clouds again: a package that reads their format may have been installed.
    stale = [
        name
        for name, state in states.items()
        if (check := results.get(name)) is None
        or check.state != state
        or (is_cloud and check.fault)
    ]
    progress = Progress(f"{Path(place).stem}: {'clouds' if is_cloud else 'meshes'} looked at:")
    for done, name in enumerate(stale, start=1):
        fault, measured = _check_scene(scenes, name, settings)
        results[name] = SceneCheck(state=states[name], fault=fault, **measured)
        progress(done, len(stale))
    if stale:
        checks = {name: check.model_dump(exclude_unset=True) for name, check in results.items()}
        memory.learn(place, checks)
    return unnamed | {name: fault for name in states if (fault := results[name].fault)}


def path_fault(path: str | Path) -> str | None:
    """Return the reason why a run cannot use a file with this path, or None if it can."""
    if _UNPRINTABLE.search(str(path)):
        return f"{printable(path)}: rename it: its path has a line break, or is not in UTF-8"
    odd = _PATTERN.search(str(path))
    return odd and f"{path}: rename it: Snakemake takes {odd[0]!r} in its path for a wildcard"


def refuse_paths(paths: Iterable[str | Path]) -> None:
    """Raise InputError if a run cannot use a file because of its path; see `path_fault`."""
    for fault in filter(None, map(path_fault, paths)):
        raise InputError(fault)


def printable(path: str | Path) -> str:
    """Return a path as text in which line breaks, and bytes that are not UTF-8, are escaped."""
    return _UNPRINTABLE.sub(lambda letter: ascii(letter[0])[1:-1], str(path))


class SceneCheck(Model):
    """The stored result of the check of one scene."""

    state: str
    """Digest of the scene's files and of the settings with which it was checked."""
    fault: str | None
    """Reason why the scene cannot be used; None if it can."""
    points: int | None = None
    """Number of points of a captured cloud."""
    extent_m: float | None = None
    """Longest side of the bounding box in m."""
    is_shifted: bool = False
    """Whether the scene is far from the origin, so that its cloud in metres is shifted."""
    attributes: tuple[str, ...] = ()
    """Names of the points' attributes besides coordinates."""
    dropped_points: int = 0
    """Number of points in the scene's files that were left out of the cloud."""


def read_checks(memory: Memory, name: str) -> dict[str, SceneCheck]:
    """Return the checks that are stored under a name, by scene."""
    checks = memory.read(name).items()
    return {scene: parsed(SceneCheck, check, f"{name}: {scene}") for scene, check in checks}


def _state(scenes: SceneSet, digest: str, settings: DataSetConfig, name: str) -> str:
    options = scenes.model_dump_json(exclude={"path"}) if isinstance(scenes, Model) else ""
    job: tuple[object, ...] = (settings.make, settings.is_metric, options, "dropped points")
    if settings.is_scan:
        scan = planned(Scan.of_entry(settings, name, seed=0), {})
        job += (scan.settings, scan.fingerprint)
    return hashlib.sha256(repr((job, digest)).encode()).hexdigest()[:16]


def _check_scene(
    scenes: SceneSet, name: str, settings: DataSetConfig
) -> tuple[str | None, dict[str, Any]]:
    from pointkit.geometry.mesh import check_mesh

    try:
        scene = scenes.load(name)
        if isinstance(scenes, FileSet):
            _remark_extent(scenes, scene, settings)
        cloud = scene.cloud
        points = scene.returns.points() if scene.returns else None if cloud is None else cloud.xyz
        if points is not None and settings.make == "cloud":
            return None, {
                "points": len(points),
                "extent_m": _extent(points),
                "is_shifted": bool(origin_shift(points).any()),
                "attributes": () if cloud is None else _attributes(cloud),
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
            Scan.of_entry(settings, name, seed=0).check(scene.mesh, scene.origin)
            return None, {}
    except InputError as error:
        return " ".join(str(error).split()), {}
    return None, {"extent_m": _extent(corners)}


def _attributes(cloud: PointCloud) -> tuple[str, ...]:
    arrays = {"normals": cloud.normals, "colours": cloud.colours, "labels": cloud.labels}
    names = [name for name, values in {**arrays, **cloud.fields}.items() if values is not None]
    return tuple(name for name in names if name not in WIDE_COLOURS)  # they repeat the colours


def _extent(points: Floats) -> float:
    low, high = bounds(points)
    return float((high - low).max())


def _remark_extent(scenes: SceneSet, scene: Scene, settings: DataSetConfig) -> None:
    path = scenes.files(scene.name)[0]
    if scene.mesh is not None and settings.is_scan:
        warn_of_implausible_extent(path, scene.mesh.bounds())
    if scene.cloud is not None and settings.is_metric:
        warn_of_implausible_extent(path, bounds(scene.cloud.xyz))
