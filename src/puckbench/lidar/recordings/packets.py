"""Decoding of VLP-16 data packets into a table of returns.

A packet has 12 blocks, each of an azimuth (0.01 degrees) and two firings of 16 lasers (distance in
units of 2 mm, reflectivity), and the time of its first firing (VLP-16 User Manual 63-9243 Rev. E,
chapter 9).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats
from puckbench.lidar.recordings.returns import BOTH, LAST, STRONGEST, RecordedReturns
from puckbench.lidar.sensor import Sensor, load_sensor
from puckbench.lidar.turns import CENTIDEGREES, clock_steps

if TYPE_CHECKING:
    from puckbench.lidar.recordings.ouster import OusterSensor

PACKET_BYTES = 1206


@dataclass(frozen=True)
class PacketLog:
    """Payloads (p, bytes) and their reception times (p,), s since 1970, in the recorded order.

    `sensor` is the metadata of an Ouster sensor; packets of a Velodyne need none.
    """

    payloads: NDArray[np.uint8]
    received: Floats
    about: dict[str, Any] = field(default_factory=dict)
    sensor: OusterSensor | None = None

    def __len__(self) -> int:
        return len(self.payloads)

    def between(self, start_s: float, end_s: float) -> PacketLog:
        """Return packets received `start_s` to `end_s` seconds after the first one."""
        since = self.received - self.received[:1]
        rows = (since >= start_s) & (since < end_s)
        return replace(self, payloads=self.payloads[rows], received=self.received[rows])


def joined(
    payloads: Sequence[bytes],
    received: Sequence[float],
    about: dict[str, Any],
    size: int = PACKET_BYTES,
) -> PacketLog:
    data = np.frombuffer(b"".join(payloads), dtype=np.uint8).reshape(-1, size)
    return PacketLog(data, np.asarray(received, dtype=np.float64), about)


BLOCKS = 12
LASERS = 16
FLAG = 0xEEFF
DISTANCE_UNIT_M = 0.002
HOUR_S = 3600.0
STRONGEST_MODE, LAST_MODE, DUAL_MODE = 0x37, 0x38, 0x39
MODES = {STRONGEST_MODE: "strongest", LAST_MODE: "last", DUAL_MODE: "dual"}
PRODUCTS = {
    0x21: "HDL-32E",
    0x22: "VLP-16",
    0x24: "Puck Hi-Res",
    0x28: "VLP-32C",
    0x31: "Velarray",
    0x63: "HDL-64E",
    0xA1: "VLS-128",
}
VLP16 = 0x22
# Sensors whose packets `decode_packets` decodes.
SENSORS = {VLP16: "vlp16", 0x24: "puck_hires"}

RETURN = np.dtype([("distance", "<u2"), ("reflectivity", "u1")])
BLOCK = np.dtype([("flag", "<u2"), ("azimuth", "<u2"), ("returns", RETURN, (2, LASERS))])
PACKET = np.dtype(
    [("blocks", BLOCK, BLOCKS), ("time_us", "<u4"), ("mode", "u1"), ("product", "u1")]
)

# A block lasts 110.6 us, in which the fastest Puck (20 Hz) turns by 0.8 degrees: a larger increase
# of the azimuth (0.01 degrees) means that blocks are missing (a limited field of view).
_LARGEST_INCREASE = 100


def decode_packets(payloads: NDArray[np.uint8], sensor: Sensor | None = None) -> RecordedReturns:
    """Decode data packets (p, 1206), in the order of arrival, into a row for each return.

    The azimuth of a firing is interpolated between its block and the next. With range R, elevation
    w and azimuth a, x = R cos(w) sin(a), y = R cos(w) cos(a), z = R sin(w) + the laser's vertical
    correction. Two equal returns of a beam are one row. By default, the packets' product code
    determines the sensor.
    """
    packets = np.ascontiguousarray(payloads).view(PACKET)[:, 0]
    mode = _checked_mode(packets)
    device = sensor or load_sensor(SENSORS[int(packets["product"][0])])
    firing_us, laser_us = _firing_times(device)
    turns, azimuth = _azimuths(packets, mode, laser_us / firing_us)
    raw = _by_firing(packets["blocks"]["returns"], mode)
    kind = _kinds(raw["distance"], mode)
    rows = (raw["distance"] > 0) & (kind >= 0)
    sequence = np.arange(raw.shape[1])[:, None] * firing_us + np.arange(LASERS) * laser_us
    times = packet_seconds(packets)[:, None, None] + sequence * 1e-6
    shaped: dict[str, NDArray[Any]] = {
        "timestamp": times[..., None],
        "turn": turns[..., None],
        "laser_id": np.arange(LASERS, dtype=np.int16)[:, None],
        "return_kind": kind,
        "azimuth": np.radians(azimuth / 100)[..., None],
        "distance": raw["distance"] * DISTANCE_UNIT_M,
        "reflectivity": raw["reflectivity"].astype(np.int16),
    }
    columns = {name: np.broadcast_to(part, rows.shape)[rows] for name, part in shaped.items()}
    about = {"sensor": device.name, "returns": MODES[mode], "packets": len(packets)}
    return RecordedReturns(with_points(columns, device), about)


def with_points(columns: dict[str, NDArray[Any]], sensor: Sensor) -> dict[str, NDArray[Any]]:
    laser = columns["laser_id"]
    elevation = np.radians(sensor.laser_elevation_deg)[laser]
    level = columns["distance"] * np.cos(elevation)
    correction = np.asarray(sensor.vertical_correction_mm or np.zeros(sensor.lasers)) / 1000
    return {
        **columns,
        "elevation": elevation,
        "x": level * np.sin(columns["azimuth"]),
        "y": level * np.cos(columns["azimuth"]),
        "z": columns["distance"] * np.sin(elevation) + correction[laser],
    }


def packet_seconds(packets: NDArray[Any]) -> Floats:
    """Return seconds since the first packet, (p,); the packets' clock restarts every hour."""
    steps = clock_steps(packets["time_us"].astype(np.float64) * 1e-6, HOUR_S)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _checked_mode(packets: NDArray[Any]) -> int:
    if len(packets) == 0:
        raise InputError("no data packet of a VLP-16 or a Puck Hi-Res")
    products = [int(code) for code in np.unique(packets["product"])]
    for code in products:
        if code not in SENSORS:
            name = PRODUCTS.get(code, "an unknown sensor")
            raise InputError(
                f"a recording of {name} (product 0x{code:02X}), not of a VLP-16 or a Puck Hi-Res"
            )
    if len(products) > 1:
        raise InputError("packets of a VLP-16 and of a Puck Hi-Res in one capture")
    modes = np.unique(packets["mode"])
    if len(modes) > 1 or int(modes[0]) not in MODES:
        listed = ", ".join(f"0x{mode:02X}" for mode in modes[:4])
        raise InputError(f"return mode {listed}, where one of 0x37, 0x38, 0x39 is expected")
    blocks = packets["blocks"]
    damaged = (blocks["flag"] != FLAG) | (blocks["azimuth"] >= CENTIDEGREES)
    if damaged.any():
        packet, block = np.argwhere(damaged)[0]
        raise InputError(f"packet {packet} is damaged: block {block} has no valid flag and azimuth")
    return int(modes[0])


def _firing_times(sensor: Sensor) -> tuple[float, float]:
    firing, laser = sensor.firing_sequence_us, sensor.firing_interval_us
    if sensor.lasers != LASERS or firing is None or laser is None:
        raise InputError(f"sensor {sensor.name} is not described as a VLP-16 (16 lasers, firing)")
    return firing, laser


def _azimuths(
    packets: NDArray[Any], mode: int, share: float
) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    """Return revolution and azimuth (0.01 degrees) of each firing, (p, sequences, 16).

    `share` is the ratio of the time between two lasers to that between two firing sequences.
    """
    azimuth = packets["blocks"]["azimuth"][:, :: 2 if _dual(mode) else 1].astype(np.int32)
    wraps = np.diff(azimuth.ravel(), prepend=azimuth[0, 0]) < -CENTIDEGREES // 2
    turn = np.cumsum(wraps).reshape(azimuth.shape)
    rise = np.mod(np.diff(azimuth, axis=1), CENTIDEGREES)
    rise = np.concatenate([rise, rise[:, -1:]], axis=1).astype(np.float64)
    usual = rise <= _LARGEST_INCREASE
    rise = np.where(usual, rise, np.median(rise[usual]) if usual.any() else 0.0)
    within = (np.arange(2)[:, None] + share * np.arange(LASERS)) / 2
    fired = azimuth[:, :, None, None] + rise[:, :, None, None] * within
    over = fired >= CENTIDEGREES
    turns = (turn[:, :, None, None] + over).astype(np.int32)
    shape = (len(packets), -1, LASERS)
    return turns.reshape(shape), np.where(over, fired - CENTIDEGREES, fired).reshape(shape)


def _by_firing(returns: NDArray[Any], mode: int) -> NDArray[Any]:
    # Shapes: blocks (p, 12, 2, 16) to (p, 24, 16, 1), or in dual mode to (p, 12, 16, 2).
    kinds = 2 if _dual(mode) else 1
    pairs = returns.reshape(len(returns), BLOCKS // kinds, kinds, 2, LASERS)
    return pairs.transpose(0, 1, 3, 4, 2).reshape(len(returns), -1, LASERS, kinds)


def _kinds(distance: NDArray[np.uint16], mode: int) -> NDArray[np.int16]:
    """Return the kind of each return (last, strongest, both), in the shape of `distance`.

    It is -1 for the second of two equal returns. In dual mode, the last return comes first.
    """
    kinds = np.full(distance.shape, LAST if MODES[mode] == "last" else STRONGEST, dtype=np.int16)
    if _dual(mode):
        alike = distance[..., 0] == distance[..., 1]
        kinds[..., 0] = np.where(alike, BOTH, LAST)
        kinds[..., 1] = np.where(alike, -1, STRONGEST)
    return kinds


def _dual(mode: int) -> bool:
    return MODES[mode] == "dual"
