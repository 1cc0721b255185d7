"""Lidar packets and metadata of Ouster sensors, laid out by hand after the user manual."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tests.support.capture_bytes import ethernet, ipv4, pcap, udp

SERIAL = 992_137_000_142
RADIAL_MM, HEIGHT_MM = 15.806, 36.18
TICKS = 90112
# Of each format: bytes of a pixel; first bit and width of ranges and reflectivities; range unit.
FORMATS: Mapping[str, tuple[int, Sequence[tuple[int, int]], Sequence[int], int]] = {
    "LEGACY": (12, [(0, 20)], [32], 1),
    "RNG19_RFL8_SIG16_NIR16": (12, [(0, 19)], [32], 1),
    "RNG19_RFL8_SIG16_NIR16_DUAL": (16, [(0, 19), (32, 19)], [24, 56], 1),
    "RNG15_RFL8_NIR8": (4, [(0, 15)], [16], 8),
    "RNG15_RFL8_NIR8_DUAL": (8, [(0, 15), (32, 15)], [16, 48], 8),
    "FUSA_RNG15_RFL8_NIR8_DUAL": (8, [(0, 15), (32, 15)], [16, 48], 8),
    "FIVE_WORD_PIXEL": (20, [(0, 19), (32, 19)], [24, 56], 1),
    "RNG19_RFL8_SIG16_NIR16_RGB16": (16, [(0, 19)], [24], 1),
}
# First bits of signals, and first bit and width of near infrared light.
LIGHT: Mapping[str, tuple[Sequence[int], tuple[int, int]]] = {
    "LEGACY": ([48], (64, 16)),
    "RNG19_RFL8_SIG16_NIR16": ([48], (64, 16)),
    "RNG19_RFL8_SIG16_NIR16_DUAL": ([64, 80], (96, 16)),
    "RNG15_RFL8_NIR8": ([], (24, 8)),
    "RNG15_RFL8_NIR8_DUAL": ([], (24, 8)),
    "FUSA_RNG15_RFL8_NIR8_DUAL": ([], (24, 8)),
    "FIVE_WORD_PIXEL": ([64, 80], (96, 16)),
    "RNG19_RFL8_SIG16_NIR16_RGB16": ([32], (48, 16)),
}

Values = NDArray[np.int64]


def metadata(profile: str, lasers: int = 16, columns: int = 512, nested: bool = True) -> Any:
    """What the sensor says of itself, in the form of newer (nested) or older firmware."""
    beams = {
        "beam_altitude_angles": np.linspace(21, -22, lasers).round(2).tolist(),
        "beam_azimuth_angles": [3.1, -1.2] * (lasers // 2),
        "lidar_origin_to_beam_origin_mm": RADIAL_MM,
    }
    to_sensor = [-1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, HEIGHT_MM, 0, 0, 0, 1]
    lidar = {"lidar_to_sensor_transform": to_sensor}
    form = {
        "columns_per_frame": columns,
        "columns_per_packet": 16,
        "pixels_per_column": lasers,
        "column_window": [0, columns - 1],
    }
    if profile != "LEGACY":
        form["udp_profile_lidar"] = profile
    about = {"prod_line": "OS-0-16", "prod_sn": str(SERIAL)}
    mode = {"lidar_mode": f"{columns}x10"}
    if not nested:
        return {**beams, **lidar, **about, **mode, "data_format": form}
    return {
        "beam_intrinsics": beams,
        "lidar_intrinsics": lidar,
        "sensor_info": about,
        "lidar_data_format": form,
        "config_params": mode,
    }


def images(
    profile: str, seed: int = 0, lasers: int = 16, columns: int = 512
) -> tuple[Values, Values]:
    """Ranges, in units of the format, and reflectivities: (kinds, columns, lasers)."""
    random = np.random.default_rng(seed)
    _, ranges, _, unit = FORMATS[profile]
    around = 2 * np.pi * np.arange(columns)[:, None] / columns
    metres = 20 + 8 * np.sin(3 * around) + 0.2 * np.arange(lasers)
    kinds = [metres + kind for kind in range(len(ranges))]
    values = np.rint(1000 / unit * np.stack(kinds)).astype(np.int64)
    values[:, random.random((columns, lasers)) < 0.2] = 0
    values[0, 5, 3] = (1 << ranges[0][1]) - 1
    return values, random.integers(0, 256, values.shape)


def packets(
    profile: str,
    ranges: Values,
    reflectivities: Values,
    frame: int = 7,
    signals: Values | None = None,
    light: Values | None = None,
) -> list[bytes]:
    """Packets of 16 columns of one revolution, whose columns are 100 us apart."""
    size, range_bits, reflectivity_bits, _ = FORMATS[profile]
    signal_bits, (light_bit, _) = LIGHT[profile]
    is_legacy = profile == "LEGACY"
    made = []
    for first in range(0, ranges.shape[1], 16):
        body = b""
        for column in range(first, first + 16):
            time = 5_000_000_000 + (frame * ranges.shape[1] + column) * 100_000
            head = struct.pack("<QH", time, column)
            head += (
                struct.pack("<HI", frame, column * TICKS // ranges.shape[1])
                if is_legacy
                else struct.pack("<H", 1)
            )
            body += head
            for laser in range(ranges.shape[2]):
                pixel = 0
                for kind, (bit, width) in enumerate(range_bits):
                    assert ranges[kind, column, laser] < 1 << width
                    pixel |= int(ranges[kind, column, laser]) << bit
                for kind, bit in enumerate(reflectivity_bits):
                    pixel |= int(reflectivities[kind, column, laser]) << bit
                for kind, bit in enumerate(signal_bits if signals is not None else ()):
                    pixel |= int(signals[kind, column, laser]) << bit  # type: ignore[index]
                if light is not None:
                    pixel |= int(light[column, laser]) << light_bit
                body += pixel.to_bytes(size, "little")
            body += b"\xff\xff\xff\xff" if is_legacy else b""
        made.append(body if is_legacy else _header(profile, frame) + body + bytes(32))
    return made


def _header(profile: str, frame: int) -> bytes:
    serial = SERIAL.to_bytes(5, "little")
    if profile.startswith("FUSA"):
        return (b"\1" + bytes(3) + struct.pack("<I", frame) + bytes(3) + serial).ljust(32, b"\0")
    return (struct.pack("<HH", 1, frame) + bytes(3) + serial).ljust(32, b"\0")


def capture(payloads: Sequence[bytes], mtu: int = 1480) -> bytes:
    """A packet capture of datagrams, in fragments of IP packets where they are larger.

    Packets of 16 columns come as fast as a sensor sends them.
    """
    frames = []
    for number, payload in enumerate(payloads):
        whole = udp(payload, 7502, 7502)
        for at in range(0, len(whole), mtu):
            more = 0x2000 * (at + mtu < len(whole))
            ip = bytearray(ipv4(whole[at : at + mtu], fragment=more | at // 8))
            ip[4:6] = struct.pack(">H", number)
            frames.append(ethernet(bytes(ip)))
    return pcap(*frames, step_us=1600)


def bag(
    path: Path,
    payloads: Sequence[bytes],
    about: str | None,
    storage: Literal["ros1", "sqlite3", "mcap"] = "ros1",
    package: str = "ouster_ros",
    extra: bytes = b"",
) -> Path:
    """A bag of the driver: packets of the lidar and the IMU, metadata, and a topic for clouds."""
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    is_ros1 = storage == "ros1"
    types = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)
    kind, string = f"{package}/msg/PacketMsg", "std_msgs/msg/String"
    types.register(get_types_from_msg("uint8[] buf", kind))
    encode = types.serialize_ros1 if is_ros1 else types.serialize_cdr
    if is_ros1:
        writer: Any = rosbag1.Writer(path)
    else:
        plugin = rosbag2.StoragePlugin[storage.upper()]
        writer = rosbag2.Writer(path, version=8, storage_plugin=plugin)
    with writer:
        lidar, imu = (
            writer.add_connection(f"/ouster/{name}_packets", kind, typestore=types)
            for name in ("lidar", "imu")
        )
        writer.add_connection("/ouster/points", "sensor_msgs/msg/PointCloud2", typestore=types)
        if about is not None:
            described = writer.add_connection("/ouster/metadata", string, typestore=types)
            message = types.types[string](data=about)
            writer.write(described, 1, bytes(encode(message, string)))
        for number, payload in enumerate(payloads):
            for topic, content in ((lidar, payload + extra), (imu, bytes(48))):
                packet = types.types[kind](buf=np.frombuffer(content, np.uint8))
                writer.write(topic, 10 + number, bytes(encode(packet, kind)))
    return path
