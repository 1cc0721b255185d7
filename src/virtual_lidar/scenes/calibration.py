"""Scenes for the measurement of range errors: a wall and a floor (thesis, section 5.1)."""

from __future__ import annotations

import numpy as np

from pointkit.errors import InputError, among
from pointkit.geometry.cloud import Floats
from pointkit.geometry.mesh import Mesh
from virtual_lidar.scenes.bodies import Body, build_mesh
from virtual_lidar.scenes.outlines import rectangle, shifted
from virtual_lidar.scenes.solids import flat
from virtual_lidar.scenes.surfaces import Surface

WIDTH, HEIGHT, SENSOR_HEIGHT = 1.6, 2.2, 1.0
ROOM_WIDTH, ROOM_HEIGHT = 5.0, 2.6
CALIBRATIONS: dict[str, float] = {f"wall_floor_{d}m": float(d) for d in (1, 2, 3, 4, 5, 30)}
"""Distances of the wall from the sensor, m, by name of the scene."""


def make_calibration(name: str, *, room: bool = False) -> Mesh:
    """Make a scene to measure range errors: a wall at y = 0, and a floor up to the sensor.

    The wall is 1.6 m wide and 2.2 m high.

    Parameters
    ----------
    name
        One of `CALIBRATIONS`, which states the distance of the wall.
    room
        Whether to add a surrounding room, which is open behind the sensor. The semantic class of
        the room is "surroundings".

    Returns
    -------
    Mesh
        The scene in metres, with z up.

    Raises
    ------
    InputError
        There is no such scene.
    """
    distance = _distance(name)
    wall = _upright(_rectangle(WIDTH, HEIGHT))
    bodies = [Body("wall", "wall", wall), Body("floor", "floor", _rectangle(WIDTH, distance))]
    around = _surroundings(distance) if room else []
    return build_mesh([*bodies, *(Body("rest", "surroundings", surface) for surface in around)])


def calibration_origin(name: str) -> tuple[float, float, float]:
    """Return the sensor's position, (x, y, z), m, in a scene of `make_calibration`."""
    return (0.0, _distance(name), SENSOR_HEIGHT)


def calibration_scene(distance: float, *, room: bool = False) -> tuple[Mesh, Floats]:
    """Make the scene of `make_calibration`, rotated so that the wall is ahead of the sensor (+y).

    Parameters
    ----------
    distance
        Distance of the wall from the sensor, m: one of those in `CALIBRATIONS`.
    room
        Whether to add a surrounding room, as in `make_calibration`.

    Returns
    -------
    mesh, origin
        The scene, and the sensor's position (3,), m.
    """
    name = f"wall_floor_{distance:g}m"
    mesh, half_turn = make_calibration(name, room=room), np.array([-1.0, -1.0, 1.0])
    turned = Mesh(mesh.vertices * half_turn, mesh.triangles, mesh.labels)
    return turned, np.array(calibration_origin(name)) * half_turn


def _surroundings(distance: float) -> list[Surface]:
    beside = (ROOM_WIDTH - WIDTH) / 2
    off = (WIDTH + beside) / 2
    above = _rectangle(WIDTH, ROOM_HEIGHT - HEIGHT)
    side = _rectangle(ROOM_HEIGHT, distance)
    ceiling = _rectangle(ROOM_WIDTH, distance)
    return [
        *(_upright(_rectangle(beside, ROOM_HEIGHT)).at(x=x) for x in (-off, off)),
        _upright(above).at(z=HEIGHT),
        *(_rectangle(beside, distance).at(x=x) for x in (-off, off)),
        side.at(roll=90).at(x=-ROOM_WIDTH / 2, z=ROOM_HEIGHT / 2),
        side.at(roll=-90).at(x=ROOM_WIDTH / 2, z=ROOM_HEIGHT / 2),
        ceiling.at(roll=180).at(z=ROOM_HEIGHT),
    ]


def _upright(surface: Surface) -> Surface:
    return surface.at(tilt=90).at(turn=180)


def _rectangle(width: float, length: float) -> Surface:
    return flat(shifted(rectangle(width, length), 0.0, length / 2))


def _distance(name: str) -> float:
    if name not in CALIBRATIONS:
        raise InputError(f"unknown calibration scene {name!r}{among(name, CALIBRATIONS)}")
    return CALIBRATIONS[name]
