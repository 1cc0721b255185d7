"""Calibration scenes of the error measurements: a wall and a floor (thesis section 5.1)."""

from __future__ import annotations

from puckbench.errors import InputError
from puckbench.mesh import Mesh
from puckbench.scenes import outlines
from puckbench.scenes.builder import Piece, build
from puckbench.scenes.solids import flat
from puckbench.scenes.surfaces import Surface

WIDTH, HEIGHT, SENSOR_HEIGHT = 1.6, 2.2, 1.0
CALIBRATIONS: dict[str, float] = {f"wall_floor_{d}m": float(d) for d in (1, 2, 3, 4, 5, 30)}


def make_calibration(name: str) -> Mesh:
    """Wall at y = 0, 1.6 m wide and 2.2 m high, and floor from it to the sensor at y = d.

    Objects: "wall_1" and "floor_1", one plane each, fronts to the sensor.
    Raises InputError for an unknown name.
    """
    distance = _distance(name)
    wall = _rectangle(HEIGHT).at(tilt=90).at(turn=180)
    floor = _rectangle(distance)
    return build([Piece("wall", "wall", wall), Piece("floor", "floor", floor)])


def calibration_origin(name: str) -> tuple[float, float, float]:
    """Where the sensor stands: 1 m above the floor's end, facing the wall (towards -y)."""
    return (0.0, _distance(name), SENSOR_HEIGHT)


def _rectangle(length: float) -> Surface:
    """Plane piece at z = 0, centred in x, from y = 0 to `length`."""
    return flat(outlines.shifted(outlines.rectangle(WIDTH, length), 0.0, length / 2))


def _distance(name: str) -> float:
    if name not in CALIBRATIONS:
        known = ", ".join(CALIBRATIONS)
        raise InputError(f"calibration scene {name!r}: unknown; there are {known}")
    return CALIBRATIONS[name]
