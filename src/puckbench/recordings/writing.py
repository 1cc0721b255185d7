from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pointkit.errors import InputError
from pointkit.files import write_bytes
from pointkit.geometry.cloud import Floats
from pointkit.lidar.sensors import load_sensor
from pointkit.lidar.turns import CENTIDEGREES
from puck.recordings.packets import (
    BLOCK,
    BLOCKS,
    DISTANCE_UNIT_M,
    FLAG,
    HOUR_S,
    LASERS,
    PACKET,
    PACKET_BYTES,
    RETURN,
    STRONGEST_MODE,
    VLP16,
    PacketLog,
)
from virtual_lidar.scan_table import ScanTable

_PORT = 2368
_SENDER, _RECEIVER = bytes([192, 168, 1, 201]), b"\xff" * 4
_MAC = b"\xff" * 6 + bytes.fromhex("607688000001")
_REFLECTIVITY = 100
"""Reflectivity of a bright diffuse surface, written for scans without reflectivities."""


def write_pcap(path: Path, table: ScanTable, noisy: bool = True) -> dict[str, int]:
    """Write a virtual scan as the packet capture of a VLP-16.

    Distances are rounded to 2 mm, and azimuths to 0.01 degrees.

    Parameters
    ----------
    path
        File to write.
    table
        Scan by a virtual VLP-16.
    noisy
        Whether to write the measured distances; otherwise, the true distances are written.

    Returns
    -------
    dict
        Numbers of ``packets`` and ``returns``.

    Raises
    ------
    InputError
        The scan is that of another sensor.
    """
    log = scan_packets(table, noisy)
    write_bytes(path, pcap_bytes(log))
    return {"packets": len(log), "returns": log.about["returns"]}


def scan_packets(table: ScanTable, noisy: bool = True) -> PacketLog:
    """Convert a virtual scan to the packets of a VLP-16.

    A real VLP-16 rotates clockwise while its lasers fire. The virtual sensor rotates
    counter-clockwise and fires all lasers at one azimuth. Therefore firings are written in reverse
    order, and each becomes two blocks of equal azimuth. The parameters are those of `write_pcap`.
    """
    rotation_hz = _rotation_hz(table)
    centidegrees = np.rint(-np.degrees(table["yaw"]) * 100).astype(np.int64) % CENTIDEGREES
    turns = np.rint(table["timestamp"] * rotation_hz - table["yaw"] / (2 * np.pi)).astype(np.int64)
    turns -= turns.min()
    columns, index = np.unique(turns * CENTIDEGREES + centidegrees, return_inverse=True)
    returns = np.zeros((len(columns), 2, 2, LASERS), dtype=RETURN)
    place = (index, 0, 0, table["laser_id"])
    returns["distance"][place] = distance_counts(table["distance_noisy" if noisy else "distance"])
    returns["reflectivity"][place] = _reflectivity(table)
    seconds = np.repeat(columns / (CENTIDEGREES * rotation_hz), 2)
    azimuth = np.repeat(columns % CENTIDEGREES, 2)
    return pack_blocks(azimuth, returns.reshape(-1, 2, LASERS), seconds)


def pack_blocks(
    azimuth: NDArray[np.int64], returns: NDArray[Any], seconds: Floats, mode: int = STRONGEST_MODE
) -> PacketLog:
    """Pack b data blocks of a VLP-16 into packets of 12 blocks.

    Parameters
    ----------
    azimuth
        Azimuths of the blocks, (b,), in 0.01 degrees.
    returns
        Distances, in units of 2 mm, and reflectivities of the returns, (b, 2, 16), as records of
        the type `RETURN`.
    seconds
        Times of the blocks, (b,), in s.
    mode
        Code of the return mode, such as `STRONGEST_MODE`.
    """
    packets = np.zeros(-(-len(azimuth) // BLOCKS), dtype=PACKET)
    blocks, start = np.zeros(len(packets) * BLOCKS, BLOCK), seconds[::BLOCKS]
    blocks["flag"] = FLAG
    blocks["azimuth"] = np.pad(azimuth, (0, -len(azimuth) % BLOCKS), mode="edge")
    blocks["returns"][: len(returns)] = returns
    packets["blocks"] = blocks.reshape(-1, BLOCKS)
    packets["time_us"] = np.rint(np.mod(start, HOUR_S) * 1e6).astype(np.int64) % 3_600_000_000
    packets["mode"], packets["product"] = mode, VLP16
    about = {"returns": int(np.count_nonzero(returns["distance"]))}
    return PacketLog(packets.view(np.uint8).reshape(-1, PACKET_BYTES), start, about)


def pcap_bytes(log: PacketLog) -> bytes:
    """Return the content of a capture file (pcap), with the packets as UDP datagrams."""
    head = struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1)
    wrapping = _MAC + b"\x08\x00" + _ip_udp_header(PACKET_BYTES)
    size = len(wrapping) + PACKET_BYTES
    parts = [head]
    for payload, time in zip(log.payloads, log.received, strict=True):
        seconds, micros = divmod(round(float(time) * 1e6), 1_000_000)
        parts += [struct.pack("<IIII", seconds, micros, size, size), wrapping, payload.tobytes()]
    return b"".join(parts)


def distance_counts(distance: Floats) -> NDArray[np.uint16]:
    """Return distances (n,), given in m, in units of 2 mm; 0 (no return) if they exceed 16 bits."""
    counts = np.rint(distance / DISTANCE_UNIT_M)
    return np.where((counts > 0) & (counts <= 0xFFFF), counts, 0).astype(np.uint16)


def _rotation_hz(table: ScanTable) -> float:
    device, sweep = table.about.get("sensor", {}), table.about.get("sweep", {})
    if tuple(device.get("laser_elevation_deg", ())) != load_sensor("vlp16").laser_elevation_deg:
        name = device.get("name", "an unknown sensor")
        raise InputError(f"a scan by {name} cannot be written as packets of a VLP-16")
    return float(sweep.get("rotation_hz") or device["rotation_hz"])


def _reflectivity(table: ScanTable) -> NDArray[np.uint8]:
    if "reflectivity" not in table.columns:
        return np.full(len(table), _REFLECTIVITY, dtype=np.uint8)
    percent: NDArray[np.uint8] = np.rint(table["reflectivity"] * 100).clip(0, 100).astype(np.uint8)
    return percent


def _ip_udp_header(payload: int) -> bytes:
    total = 20 + 8 + payload
    head = struct.pack(">BBHHHBBH", 0x45, 0, total, 0, 0x4000, 64, 17, 0) + _SENDER + _RECEIVER
    words = sum(struct.unpack(">10H", head))
    checksum = ~((words & 0xFFFF) + (words >> 16)) & 0xFFFF
    udp = struct.pack(">HHHH", _PORT, _PORT, 8 + payload, 0)
    return head[:10] + struct.pack(">H", checksum) + head[12:] + udp
