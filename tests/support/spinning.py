"""Recordings of spinning sensors in a box-shaped room with noise, packet by packet."""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

from puckbench.lidar import load_sensor
from puckbench.lidar.recordings.packets import FLAG

VLP16, PUCK_HIRES, HDL32E, VLP32C = 0x22, 0x24, 0x21, 0x28
STRONGEST, DUAL = 0x37, 0x39
SENSORS = {VLP16: "vlp16", PUCK_HIRES: "puck_hires", HDL32E: "hdl32e", VLP32C: "vlp32c"}
RETURN = np.dtype([("distance", "<u2"), ("reflectivity", "u1")])
BLOCK = np.dtype([("flag", "<u2"), ("azimuth", "<u2"), ("returns", RETURN, 32)])
PACKET = np.dtype([("blocks", BLOCK, 12), ("time", "<u4"), ("mode", "u1"), ("product", "u1")])


def spin(
    product: int = VLP16, mode: int = STRONGEST, packets: int = 40, rise: int = 160, seed: int = 0
) -> NDArray[np.uint8]:
    """Packets (p, 1206): blocks rise by about `rise` hundredths of a degree."""
    random = np.random.default_rng(seed)
    sensor = load_sensor(SENSORS[product])
    shared = 2 if mode == DUAL else 1
    blocks = packets * 12 // shared
    azimuth = (1234 + np.cumsum(rise + random.integers(-1, 2, blocks))) % 36000
    columns = 32 // sensor.lasers
    within = np.arange(columns) * rise / columns
    angle = np.radians((azimuth[:, None] + within) / 100)[..., None]
    elevation = np.radians(sensor.laser_elevation_deg)
    metres = _room(angle, elevation) + random.normal(0, 0.006, (blocks, columns, sensor.lasers))
    returned = random.random(metres.shape) < 0.8
    distance = np.where(returned, np.rint(metres / (sensor.range_quantum_mm / 1000)), 0).astype(
        np.uint16
    )
    reflectivity = (20 + 10 * np.sin(3 * angle) + random.integers(0, 4, metres.shape)).astype("u1")
    table = np.zeros((packets, 12), BLOCK)
    table["flag"] = FLAG
    table["azimuth"] = np.repeat(azimuth, shared).reshape(packets, 12)
    returns = table["returns"].reshape(blocks, shared, 32)
    returns["distance"] = distance.reshape(blocks, 1, 32)
    returns["reflectivity"] = reflectivity.reshape(blocks, 1, 32)
    if shared == 2:
        other = random.random((blocks, 32)) < 0.05
        returns["distance"][:, 0] += np.where(other, 200, 0).astype(np.uint16)
    result = np.zeros(packets, PACKET)
    result["blocks"], result["mode"], result["product"] = table, mode, product
    result["time"] = 3_599_990_000 + np.arange(packets) * 1327 + random.integers(0, 2, packets)
    result["time"] %= 3_600_000_000
    return result.view(np.uint8).reshape(packets, 1206)


def nothing_seen(packets: int) -> NDArray[np.uint8]:
    """Packets (p, 1206) of a VLP-16 whose window is covered."""
    result = np.zeros(packets, PACKET)
    blocks = result["blocks"]
    blocks["flag"] = FLAG
    blocks["azimuth"] = (20 * np.arange(packets * 12) % 36000).reshape(packets, 12)
    result["time"], result["mode"], result["product"] = 1327 * np.arange(packets), STRONGEST, VLP16
    return result.view(np.uint8).reshape(packets, 1206)


def _room(angle: NDArray[np.float64], elevation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distances to the nearest wall, floor or ceiling of a room of 8 m by 6 m by 3 m."""
    across = np.maximum(np.abs(np.sin(angle)) / 4, np.abs(np.cos(angle)) / 3) * np.cos(elevation)
    return 1 / np.maximum(across, np.abs(np.sin(elevation)) / 1.5)


def pcap(payloads: list[bytes], seed: int = 0) -> bytes:
    """A packet capture of datagrams, received with jitter."""
    random = np.random.default_rng(seed)
    parts = [struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1)]
    for number, payload in enumerate(payloads):
        micros = number * 1327 + int(random.integers(0, 50))
        size = 42 + len(payload)
        parts.append(struct.pack("<IIII", 1_600_000_000, micros, size, size))
        parts.append(b"\xff" * 12 + b"\x08\x00" + struct.pack(">BBHH", 0x45, 0, size - 14, number))
        parts.append(b"\x40\x00\x40\x11\x00\x00" + bytes([192, 168, 1, 201]) + b"\xff" * 4)
        parts.append(struct.pack(">HHHH", 2368, 2368, size - 34, 0) + payload)
    return b"".join(parts)


def rows(packets: NDArray[np.uint8]) -> list[bytes]:
    """The payloads of packets."""
    return [row.tobytes() for row in packets]
