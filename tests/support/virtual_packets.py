"""Packets of an HDL-64E or a VLS-128 from virtual scans.

python -m tests.support.virtual_packets hdl64e_s3 OUT.pcap [TURNS]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pointkit.lidar.sensors import load_sensor
from pointkit.lidar.turns import Turn
from pointkit.seeding import generator
from puck.recordings.packet_turns import packet_kind, packets_of
from tests.support.spinning import HDL64E, SENSORS, STATUS, STRONGEST, pcap, rows
from virtual_lidar import open_error_model, open_sweep, scan
from virtual_lidar.scan_returns import returns_of_scan
from virtual_lidar.scenes.street import make_street, street_origin


def virtual_packets(product: int, turns: int = 3, columns: int | None = None) -> NDArray[np.uint8]:
    """Packets (p, 1206) of a sensor in a generated street, with the noise of `vlp16`.

    A firing has the ranges of the columns at which its lasers point. Offsets of beams from the axis
    and near corrections are left out. Reflectivities are those of diffuse surfaces.
    """
    sensor, mesh = load_sensor(SENSORS[product]), make_street("street_1", seed=1, length=80.0)
    random, hertz = generator(1, "virtual packets", sensor.name), sensor.rotation_hz
    step = 360 / columns if columns else sensor.azimuth_step_deg
    level = {"pitch_start_deg": 0.0, "pitch_end_deg": 0.0, "azimuth_step_deg": step}
    sweep = open_sweep({"frames_per_second": hertz, "duration_s": turns / hertz, **level})
    table = scan(mesh, sensor, sweep, open_error_model("vlp16", None), street_origin(), random)
    scanned = returns_of_scan(table)
    ranges = np.concatenate([turn.ranges[0] for turn in scanned.returns.turns]).astype(np.int64)
    bright = np.zeros(ranges.shape)
    bright[ranges > 0] = 60 * np.cos(table["incidence"][scanned.rows])
    bright = (bright + random.normal(0, 2, bright.shape)).clip(0, 255)
    quanta = np.array(sensor.distance_correction_mm or 0.0) / (sensor.range_quantum_mm or 2.0)
    ranges = np.where(ranges > 0, (ranges - np.rint(quanta).astype(int)).clip(0, 65535), 0)
    kind = packet_kind(product, STRONGEST)
    firings = len(ranges) // kind.layout.blocks_per_time * kind.layout.blocks_per_time
    at = (np.arange(firings)[:, None] + np.array(kind.layout.shifts)) % len(ranges)
    azimuths = np.concatenate([turn.azimuths for turn in scanned.returns.turns])[:firings]
    lasers = np.arange(sensor.lasers)
    starts = np.arange(0, firings, kind.layout.blocks_per_time)
    turn = Turn(
        ranges[at, lasers][None].astype(np.uint16),
        azimuths,
        np.rint(starts * step / (360 * hertz) * 1e6).astype(np.uint32),
        bright[at, lasers][None].astype(np.uint8),
    )
    number = np.arange(len(starts))
    types = np.frombuffer(STATUS, np.uint8)[number % len(STATUS)]
    status = np.column_stack([types, number % 251]) if product == HDL64E else None
    return packets_of(kind, turn, status)


if __name__ == "__main__":
    names = {name: product for product, name in SENSORS.items()}
    made = virtual_packets(names[sys.argv[1]], *map(int, sys.argv[3:]))
    Path(sys.argv[2]).write_bytes(pcap(rows(made)))
