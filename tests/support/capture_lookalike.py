"""Captures of a Puck in an empty box, from closed form: what a real one would have sent."""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

from pointkit.geometry.cloud import Floats
from pointkit.lidar.sensors import load_sensor
from puck.recordings.packets import LASERS, RETURN, PacketLog
from puckbench.recordings.writing import distance_counts, pack_blocks

BOX = np.array([1.5, 2.0, 0.9])
"""Half the size of the box, m; the sensor stands in its middle."""
ROTATION_HZ = 10.0
_BLOCK_S, _FIRING_S, _LASER_S = 110.592e-6, 55.296e-6, 2.304e-6


def distances_in_box(azimuth: Floats, elevation: Floats) -> Floats:
    """Distance from the middle of the box to its surface, azimuth clockwise from y, rad."""
    level = np.cos(elevation)
    rays = [level * np.sin(azimuth), level * np.cos(azimuth), np.sin(elevation)]
    with np.errstate(divide="ignore"):
        walls = [half / np.abs(ray) for half, ray in zip(BOX, rays, strict=True)]
    nearest: Floats = np.min(np.broadcast_arrays(*walls), axis=0)
    return nearest


def box_capture(packets: int, dual: bool = False, start_deg: float = 350.0) -> PacketLog:
    """Packets from a box, strongest return or dual: in dual mode lasers 4 and 9 pass through glass.

    Laser 2 never returns. The last return of the dual lasers is 0.25 m behind the strongest.
    """
    pairs = packets * (6 if dual else 12)
    time = np.arange(pairs) * _BLOCK_S
    fired = time[:, None, None] + np.arange(2)[:, None] * _FIRING_S + np.arange(LASERS) * _LASER_S
    azimuth = np.radians(start_deg + 360 * ROTATION_HZ * fired)
    elevation = np.radians(load_sensor("vlp16").laser_elevation_deg)
    returns = np.zeros((pairs, 2 if dual else 1, 2, LASERS), dtype=RETURN)
    returns["distance"] = distance_counts(distances_in_box(azimuth, elevation))[:, None]
    returns["reflectivity"] = np.arange(LASERS) * 5
    returns[..., 2] = 0
    if dual:
        returns["distance"][:, 0, :, [4, 9]] += 125
    kinds = returns.shape[1]
    block_azimuth = np.rint(100 * (start_deg + 360 * ROTATION_HZ * time)).astype(np.int64) % 36000
    blocks = returns.reshape(-1, 2, LASERS)
    seconds = np.repeat(time, kinds) + 3599.999
    return pack_blocks(np.repeat(block_azimuth, kinds), blocks, seconds, 0x39 if dual else 0x37)


def scan_message(payloads: NDArray[np.uint8], order: str = "<") -> bytes:
    """A serialised velodyne_msgs/VelodyneScan of the payloads, stamped 5.25, 6.25, ... s."""
    parts = [b"\x00\x01\x00\x00" if order == "<" else b"\x00\x00\x00\x00"]
    parts.append(struct.pack(order + "iII", 5, 250_000_000, 9) + b"velodyne\x00" + b"\x00" * 3)
    parts.append(struct.pack(order + "I", len(payloads)))
    for k, payload in enumerate(payloads):
        parts += [struct.pack(order + "iI", 5 + k, 250_000_000), payload.tobytes(), b"\x00\x00"]
    return b"".join(parts)[:-2]
