"""Recordings of spinning sensors in a box-shaped room with noise, packet by packet."""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

from pointkit.lidar.sensors import load_sensor

VLP16, PUCK_HIRES, HDL32E, VLP32C, HDL64E, VLS128 = 0x22, 0x24, 0x21, 0x28, 0x63, 0xA1
STRONGEST, DUAL = 0x37, 0x39
SENSORS = {
    VLP16: "vlp16",
    PUCK_HIRES: "puck_hires",
    HDL32E: "hdl32e",
    VLP32C: "vlp32c",
    HDL64E: "hdl64e_s3",
    VLS128: "alpha_prime",
}
FLAGS = (0xEEFF, 0xDDFF, 0xCCFF, 0xBBFF)
# Bank and return (strongest, last) of the blocks of a firing.
BLOCKS = {
    (HDL64E, STRONGEST): ["0s", "1s"],
    (HDL64E, DUAL): ["0s", "1s", "0l", "1l"],
    (VLS128, STRONGEST): ["0s", "1s", "2s", "3s"],
    (VLS128, DUAL): ["0l", "0s", "1l", "1s", "2l", "2s", "3l", "3s"],
}
STATUS = b"HMSDNYGTV1234567"  # types of the last bytes but one of packets of an HDL-64E S2
RETURN = np.dtype([("distance", "<u2"), ("reflectivity", "u1")])
BLOCK = np.dtype([("flag", "<u2"), ("azimuth", "<u2"), ("returns", RETURN, 32)])
PACKET = np.dtype([("blocks", BLOCK, 12), ("time", "<u4"), ("mode", "u1"), ("product", "u1")])


def spin(
    product: int = VLP16, mode: int = STRONGEST, packets: int = 40, rise: int = 160, seed: int = 0
) -> NDArray[np.uint8]:
    """Packets (p, 1206): blocks rise by about `rise` hundredths of a degree."""
    random = np.random.default_rng(seed)
    sensor = load_sensor(SENSORS[product])
    order = BLOCKS.get((product, mode), ["0l", "0s"] if mode == DUAL else ["0s"])
    firings, banks = packets * (12 // len(order)), max(sensor.lasers // 32, 1)
    azimuth = (1234 + np.cumsum(rise + random.integers(-1, 2, firings))) % 36000
    columns = max(32 // sensor.lasers, 1)
    within = np.arange(columns) * rise / columns
    angle = np.radians((azimuth[:, None] + within) / 100)[..., None]
    elevation = np.radians(sensor.laser_elevation_deg)
    metres = _room(angle, elevation) + random.normal(0, 0.006, (firings, columns, sensor.lasers))
    returned = random.random(metres.shape) < 0.8
    distance = np.where(returned, np.rint(metres / (sensor.range_quantum_mm / 1000)), 0).astype(
        np.uint16
    )
    reflectivity = (20 + 10 * np.sin(3 * angle) + random.integers(0, 4, metres.shape)).astype("u1")
    last = distance.reshape(firings, banks, 32).copy()
    if mode == DUAL:
        other = random.random((firings, banks * 32)) < 0.05
        last += np.where(other, 200, 0).astype(np.uint16).reshape(last.shape)
    blocks = np.zeros((firings, len(order)), BLOCK)
    for place, (bank, kind) in enumerate(order):
        of_kind = last if kind == "l" else distance.reshape(last.shape)
        blocks["flag"][:, place], blocks["azimuth"][:, place] = FLAGS[int(bank)], azimuth
        blocks["returns"]["distance"][:, place] = of_kind[:, int(bank)]
        blocks["returns"]["reflectivity"][:, place] = reflectivity.reshape(last.shape)[:, int(bank)]
    blocks = blocks.reshape(packets, -1)
    table = np.zeros((packets, 12), BLOCK)
    table["azimuth"] = blocks["azimuth"][:, :1]
    table[:, : blocks.shape[1]] = blocks
    result = np.zeros(packets, PACKET)
    result["blocks"], result["mode"], result["product"] = table, mode, product
    result["time"] = 3_599_990_000 + np.arange(packets) * 1327 + random.integers(0, 2, packets)
    result["time"] %= 3_600_000_000
    if product == HDL64E:
        result["mode"] = np.frombuffer(STATUS, np.uint8)[np.arange(packets) % len(STATUS)]
        result["product"] = np.arange(packets) % 251
    return result.view(np.uint8).reshape(packets, 1206)


def nothing_seen(packets: int) -> NDArray[np.uint8]:
    """Packets (p, 1206) of a VLP-16 whose window is covered."""
    result = np.zeros(packets, PACKET)
    blocks = result["blocks"]
    blocks["flag"] = FLAGS[0]
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
