from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from pointkit.lidar.return_table import ReturnTable, return_table_of
from pointkit.lidar.returns import USUAL_QUANTUM_M, Beams, Firing, Returns
from pointkit.lidar.sensor import Sensor
from pointkit.lidar.turns import CENTIDEGREES, MAX_RANGE, Layout, Turn
from pointkit.models import parsed
from virtual_lidar.scan_table import ScanTable
from virtual_lidar.sweep import Sweep


@dataclass(frozen=True)
class ScanReturns:
    """A virtual scan in the integer form that its sensor would report, as codecs of returns need.

    Parameters
    ----------
    returns
        Ranges in the sensor's units, arranged by revolution, laser and firing.
    rows
        Row number in the scan's table of each return, (n,), in the order of ``returns.points()``.
    still_at
        Position of the sensor, (3,), m, if the sensor is level and at rest, otherwise None.
    """

    returns: Returns
    rows: NDArray[np.intp]
    still_at: Floats | None

    def table(self) -> ReturnTable:
        """Return the returns in the form of a recording, which `recorded_planes` accepts."""
        return return_table_of(self.returns)


def returns_of_scan(table: ScanTable, clean: bool = False) -> ScanReturns:
    """Convert a virtual scan to the integers that its sensor would report.

    Ranges are rounded to the sensor's range unit, and azimuths to 0.01 degrees. A return is left
    out if its rounded range is 0 or exceeds the largest range: that of 16 bits or, for sensors with
    longer ranges, `pointkit.lidar.turns.MAX_RANGE`.

    Parameters
    ----------
    table
        A scan each of whose frames is one whole revolution of the sensor, such as a scan with the
        sweep ``spin``.
    clean
        Whether to convert the true distances; by default, the measured distances are converted.

    Returns
    -------
    ScanReturns
        The returns, and the row of the table from which each one comes.

    Raises
    ------
    InputError
        A frame is not one revolution, or the table does not describe its sensor and sweep.
    """
    sensor = parsed(Sensor, table.about.get("sensor"), "the scan's sensor")
    sweep = parsed(Sweep, table.about.get("sweep"), "the scan's sweep")
    hertz = sweep.turning_hz(sensor)
    if not np.isclose(hertz, sweep.frames_per_second, rtol=1e-9):
        raise InputError(
            f"the scan has {sweep.frames_per_second:g} frames a second, and the sensor turns "
            f"{hertz:g} times: frames must be whole turns"
        )
    firing: Firing = "sequential" if sweep.timing == "firing" else "simultaneous"
    beams = Beams.of(sensor, firing, is_virtual=True)
    quantum = sensor.range_quantum_mm / 1000 if sensor.range_quantum_mm else USUAL_QUANTUM_M
    quanta = np.rint(table["distance" if clean else "distance_noisy"] / quantum)
    is_wide = sensor.max_range_m / quantum > 0xFFFF
    rows = np.flatnonzero((quanta > 0) & (quanta <= (MAX_RANGE if is_wide else 0xFFFF)))
    laser, step = table["laser_id"][rows], sweep.step_deg(sensor)
    column = np.rint(np.degrees(table["yaw"][rows]) / step - np.asarray(beams.delays)[laser])
    shape = (sweep.frames, 1, sweep.steps(sensor), sensor.lasers)
    images = np.zeros(shape, np.uint32 if is_wide else np.uint16)
    images[table["frame"][rows], 0, column.astype(np.intp), laser] = quanta[rows]
    order = tuple(int(laser) for laser in np.argsort(sensor.laser_elevation_deg, kind="stable"))
    azimuths = np.rint(np.arange(images.shape[2]) * step * 100) % CENTIDEGREES
    seconds = sweep.timestamps(sensor, range(sweep.frames))
    turns = tuple(
        Turn(image, azimuths.astype(np.uint16), np.rint(times * 1e6).astype(np.uint32))
        for image, times in zip(images, seconds, strict=True)
    )
    still_at = np.asarray(table.about["origin"]) if sweep.is_level_and_still else None
    return ScanReturns(Returns(beams, Layout(order), turns, quantum, sensor.name), rows, still_at)


def true_points(table: ScanTable, scan_returns: ScanReturns) -> Floats:
    """Return the true points of a scan's returns in sensor coordinates, (n, 3), m.

    Parameters
    ----------
    table
        The scan.
    scan_returns
        The same scan after `returns_of_scan`. The points are in the order of its returns.
    """
    return sensor_points(table)[scan_returns.rows]


def sensor_points(table: ScanTable, distances: str = "distance") -> Floats:
    """Return the points of a scan in sensor coordinates, (n, 3), m, each at its firing.

    Parameters
    ----------
    table
        The scan.
    distances
        Column of the distances: the true ``distance`` or the measured ``distance_noisy``.
    """
    yaw, pitch = table["yaw"], table["pitch"]
    level, height = table[distances] * np.cos(pitch), table[distances] * np.sin(pitch)
    return np.column_stack([-level * np.sin(yaw), level * np.cos(yaw), height])


def frame_poses(table: ScanTable) -> Floats | None:
    """Return the poses of the virtual sensor at the beginnings of its frames.

    Returns
    -------
    array or None
        Matrices (frames, 4, 4) that transform from sensor to world coordinates, in m; None if the
        table does not say where the sensor is.
    """
    if table.about.get("origin") is None or not table.about.get("sweep"):
        return None
    sweep = parsed(Sweep, table.about["sweep"], "the scan's sweep")
    poses = np.tile(np.eye(4), (sweep.frames, 1, 1))
    if sweep.trajectory is None:
        poses[:, :3, :3] = sweep.rotations()
    else:
        placed = sweep.poses_during(np.arange(sweep.frames) / sweep.frames_per_second)
        poses[:, :3, :3], poses[:, :3, 3] = placed.rotations, placed.positions
    poses[:, :3, 3] += table.about["origin"]
    return poses
