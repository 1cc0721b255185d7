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
    """Returns of a scan, as its sensor would report them.

    Parameters
    ----------
    returns
        Ranges by revolution, laser and firing.
    rows
        Row in the scan's table of each return, in the order of ``returns.points()``, (n,).
    still_at
        Position of the sensor, (3,), m, if it is level and at rest, otherwise None.
    """

    returns: Returns
    rows: NDArray[np.intp]
    still_at: Floats | None

    def table(self) -> ReturnTable:
        """Return the returns as a table, like those of a recording, for `recorded_planes`."""
        return return_table_of(self.returns)


def returns_of_scan(table: ScanTable, clean: bool = False) -> ScanReturns:
    """Convert a scan to what its sensor would report, for codecs of returns.

    Ranges are rounded to the sensor's quantum, azimuths to 0.01 degrees. Returns are left out if
    the rounded range is 0 or exceeds 16 bits (for sensors with longer ranges:
    `pointkit.lidar.turns.MAX_RANGE`).

    Parameters
    ----------
    table
        A scan whose frames are whole revolutions, such as one with the sweep ``spin``.
    clean
        Whether to take the true distances in place of the measured ones.

    Raises
    ------
    InputError
        A frame is not a revolution, or the table does not describe its sensor and sweep.
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
    """Return the points without errors of a scan's returns, in sensor coordinates, (n, 3), m."""
    rows = scan_returns.rows
    yaw, pitch = table["yaw"][rows], table["pitch"][rows]
    level = table["distance"][rows] * np.cos(pitch)
    height = table["distance"][rows] * np.sin(pitch)
    return np.column_stack([-level * np.sin(yaw), level * np.cos(yaw), height])
