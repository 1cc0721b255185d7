"""Turns of spinning sensors that several benchmarks of G-PCC code, on a grid of millimetres."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gpcc.sensor import SensorDescription, describe_sensor
from pointkit.geometry.morton import Ints
from pointkit.lidar.returns import Beams, Returns
from pointkit.lidar.sensors import load_sensor
from pointkit.seeding import generator
from puckbench.recordings.reading import read_recording
from virtual_lidar import free_origin, open_error_model, open_sweep, scan
from virtual_lidar.scan_returns import returns_of_scan
from virtual_lidar.scan_table import ScanTable
from virtual_lidar.scenes.rooms import make_room

UNIT_M = 0.001
SENSORS = ("vlp16", "puck_hires", "hdl32e", "hdl64e_s2")


class Turn(NamedTuple):
    """Points (n, 3) in the order of the returns, mm, and the sensor that measured them."""

    name: str
    points: Ints
    sensor: SensorDescription


def virtual_turn(
    name: str, errors: str = "vlp16", turns: int = 1, step_deg: float | None = None
) -> Turn:
    """A level sensor of the given name in the middle of a generated office, in its coordinates."""
    mesh, sensor = make_room("office_1", seed=1), load_sensor(name)
    hertz = sensor.rotation_hz
    level = {"pitch_start_deg": 0.0, "pitch_end_deg": 0.0, "azimuth_step_deg": step_deg}
    sweep = open_sweep({"frames_per_second": hertz, "duration_s": turns / hertz, **level})
    origin, random = free_origin(mesh), generator(1, "gpcc benchmark", name)
    table = scan(mesh, sensor, sweep, open_error_model(errors, None), origin, random)
    position = np.rint(np.asarray(origin) / UNIT_M).astype(np.int64)
    points = np.rint(table.xyz_noisy / UNIT_M).astype(np.int64)
    x, y, z = position.tolist()
    steps = round(360 / (step_deg or sensor.azimuth_step_deg))
    beams = Beams.of(sensor, is_virtual=True)
    return Turn(f"virtual {name}", points, describe_sensor(beams, UNIT_M, steps, (x, y, z)))


def virtual_scan(name: str, turns: int = 1) -> ScanTable:
    """Return a scan of turns of a level virtual sensor in a generated office."""
    mesh, sensor = make_room("office_1", seed=1), load_sensor(name)
    sweep = open_sweep(
        {
            "frames_per_second": sensor.rotation_hz,
            "duration_s": turns / sensor.rotation_hz,
            "pitch_start_deg": 0.0,
            "pitch_end_deg": 0.0,
        }
    )
    random = generator(1, "benchmark of returns", name)
    model, origin = open_error_model("vlp16", None), free_origin(mesh)
    return scan(mesh, sensor, sweep, model, origin, random)


def virtual_returns(name: str, turns: int = 1) -> Returns:
    """Return the returns of a `virtual_scan`."""
    return returns_of_scan(virtual_scan(name, turns)).returns


def recorded_turns(path: Path) -> Iterator[Turn]:
    """The whole turns of a VLP-16's recording, the strongest return of each laser."""
    table = read_recording(path)
    points = np.stack([table[axis] for axis in "xyz"], axis=1)
    hertz = 1 / np.median(np.diff([table["timestamp"][table["turn"] == t][0] for t in (1, 2, 3)]))
    sensor = describe_sensor(Beams.of(load_sensor("vlp16")), UNIT_M, round(1e6 / 55.296 / hertz))
    for number in range(1, int(table["turn"].max())):
        chosen = (table["turn"] == number) & (table["return_kind"] % 2 == 0)
        grid = np.rint(points[chosen] / UNIT_M).astype(np.int64)
        yield Turn(f"{path.name[:16]} turn {number}", grid, sensor)


def odd_turns() -> Iterator[Turn]:
    """Clouds that no sensor measures, with a sensor nevertheless."""
    random = np.random.default_rng(0)
    data_sheet = load_sensor("hdl32e")
    steps = round(360 / data_sheet.azimuth_step_deg)
    sensor = describe_sensor(Beams.of(data_sheet), UNIT_M, steps)
    one = SensorDescription((0.1,), (30.0,), 900, (40, -30, 10))
    two = SensorDescription((0.2, -0.1), (0.0, 5.0), 360)
    column = np.array([1, 1, 3000])
    cube: Ints = random.integers(-3000, 3000, (3000, 3))
    yield Turn("one point", cube[:1], sensor)
    yield Turn("the sensor itself", np.zeros((1, 3), np.int64), sensor)
    yield Turn("two points", cube[:2], sensor)
    yield Turn("cube, one laser", cube, one)
    yield Turn("cube, two lasers", cube, two)
    yield Turn("cube beside the sensor", cube, replace(sensor, position=(1 << 20, -(1 << 21), 7)))
    yield Turn("dense", random.integers(0, 40, (20_000, 3)), sensor)
    yield Turn("above the sensor", random.integers(-2, 3, (500, 3)) * column, sensor)
    yield Turn("plane", cube * np.array([1, 1, 0]), sensor)
    yield Turn("line", cube[:600] * np.array([1, 0, 0]), sensor)
    yield Turn("few, many times", np.repeat(cube[:60], 12, axis=0), sensor)
    yield Turn("pairs", np.repeat(cube, 2, axis=0) + random.integers(0, 3, (6000, 3)), sensor)


def all_turns(
    recordings: list[Path], step_deg: float | None, clean_step_deg: float | None, most: int
) -> Iterator[Turn]:
    for name in SENSORS:
        yield virtual_turn(name, step_deg=step_deg)
    yield virtual_turn("vlp16", "none", 2, clean_step_deg)
    for path in recordings:
        yield from islice(recorded_turns(path), most)
    yield from odd_turns()
