"""Recordings of a virtual Puck in an empty room."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pointkit.geometry.mesh import Mesh
from pointkit.lidar.return_table import ReturnTable
from pointkit.lidar.sensors import load_sensor
from tests.support.sensor_scenes import ROOM, room
from virtual_lidar import ScanTable, open_error_model, open_sweep, returns_of_scan, scan

ROTATION_HZ = 10.0
STEP_DEG = 0.5
NOISE = {"bias_sigma_m": 0.008, "ray_sigma_m": 0.0063, "bias_redrawn": "scan"}


def room_scan(
    turns: float = 4,
    origin: ArrayLike = tuple(ROOM / 2),
    *,
    mesh: Mesh | None = None,
    path: tuple[tuple[float, ...], ...] | None = None,
    noise: dict[str, Any] | None = None,
    pitch_deg: float = 0.0,
    seed: int = 0,
) -> ScanTable:
    """Turns of a sensor in the room, noise as `vlp16` has it (default: none)."""
    pose = {"pitch_start_deg": pitch_deg, "pitch_end_deg": pitch_deg} if path is None else {}
    sweep = open_sweep(
        {
            "duration_s": turns / ROTATION_HZ,
            "frames_per_second": ROTATION_HZ,
            "rotation_hz": ROTATION_HZ,
            "azimuth_step_deg": STEP_DEG,
            **pose,
            **({"trajectory": path} if path else {}),
        }
    )
    model = open_error_model("vlp16", noise) if noise else open_error_model("none")
    rng = np.random.default_rng(seed)
    place = np.asarray(origin, dtype=float)
    return scan(mesh or room(), load_sensor("vlp16"), sweep, model, place, rng)


def captured(table: ScanTable) -> ReturnTable:
    """The returns that the sensor of a scan would report."""
    return returns_of_scan(table).table()
