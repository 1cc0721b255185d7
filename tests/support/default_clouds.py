"""Clouds like those of the default run: sampled objects and rooms, clean and noisy scans."""

from collections.abc import Callable
from functools import partial

import numpy as np

from pointkit.geometry.cloud import PointCloud
from pointkit.lidar.sensor import load_sensor
from puckbench.geometry.sampling import sample_surface
from puckbench.scene_sets.embedded_objects import EmbeddedObjects
from puckbench.scene_sets.embedded_rooms import EmbeddedRooms
from puckbench.steps.preparation import prepare
from virtual_lidar.errors import open_error_model
from virtual_lidar.placement import free_origin
from virtual_lidar.scanning import scan
from virtual_lidar.sweep import open_sweep


def _sampled(
    scenes: EmbeddedObjects | EmbeddedRooms, name: str, points: int = 40_000
) -> PointCloud:
    mesh = scenes.load(name).mesh
    assert mesh is not None
    return prepare(sample_surface(mesh, points, np.random.default_rng(0)))


def _scanned(name: str, errors: str) -> PointCloud:
    """A room swept with a third of the default run's rays."""
    mesh = EmbeddedRooms().load(name).mesh
    assert mesh is not None
    sweep, model = open_sweep({"azimuth_step_deg": 1.8}), open_error_model(errors)
    sensor, rng = load_sensor("vlp16"), np.random.default_rng(0)
    result = scan(mesh, sensor, sweep, model, free_origin(mesh), rng)
    return prepare(PointCloud(result.xyz_noisy))


def sampled_room(name: str, points: int) -> PointCloud:
    """Points at random on the surfaces of a generated room."""
    return _sampled(EmbeddedRooms(), name, points)


CLOUDS: dict[str, Callable[[], PointCloud]] = {
    "airplane_01": partial(_sampled, EmbeddedObjects(), "airplane_01"),
    "chair_01": partial(_sampled, EmbeddedObjects(), "chair_01"),
    "office_1, raw": partial(_sampled, EmbeddedRooms(), "office_1"),
    "office_1, clean scan": partial(_scanned, "office_1", "none"),
    "office_1, noisy scan": partial(_scanned, "office_1", "vlp16_divergence"),
}
RAW_ROOM = partial(sampled_room, "office_1", 120_000)
"""The default run's raw room, with as many points."""
