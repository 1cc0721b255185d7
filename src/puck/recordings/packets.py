"""Format of data packets of Velodyne sensors, and logs of received packets.

A packet has 12 blocks, each with a flag, an azimuth (0.01 degrees) and 32 returns (distance,
reflectivity). The returns are two firings of a VLP-16, one firing of a sensor with 32 lasers, or
one firing of a larger sensor's bank of 32 lasers, which the flag names. The packet's time is that
of the first firing (VLP-16 User Manual 63-9243 Rev. E, chapter 9).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pointkit.geometry.cloud import Floats

if TYPE_CHECKING:
    from puck.recordings.ouster import OusterSensor

PACKET_BYTES = 1206


@dataclass(frozen=True)
class PacketLog:
    """Packets of a recording in the recorded order, with the times at which they were received.

    The payloads (p, bytes) are the packets' contents; the times (p,) are in seconds since 1970. For
    an Ouster sensor, `sensor` is the sensor's metadata; for a Velodyne it is None.
    """

    payloads: NDArray[np.uint8]
    received: Floats
    about: dict[str, Any] = field(default_factory=dict)
    sensor: OusterSensor | None = None

    def __len__(self) -> int:
        return len(self.payloads)

    def between(self, start_s: float, end_s: float) -> PacketLog:
        """Return the packets received from `start_s` to `end_s` seconds after the earliest one."""
        since = self.received - self.received.min(initial=np.inf)
        rows = (since >= start_s) & (since < end_s)
        if rows.all():
            return self  # without a copy
        return replace(self, payloads=self.payloads[rows], received=self.received[rows])


def joined(
    payloads: Sequence[bytes],
    received: Sequence[float],
    about: dict[str, Any],
    size: int = PACKET_BYTES,
) -> PacketLog:
    """Return packets as a log.

    Parameters
    ----------
    payloads
        Contents of the packets, `size` bytes each.
    received
        Times of reception, in seconds since 1970.
    about
        Facts about the recording, for `PacketLog.about`.
    size
        Number of bytes of a packet.
    """
    data = np.frombuffer(b"".join(payloads), dtype=np.uint8).reshape(-1, size)
    return PacketLog(data, np.asarray(received, dtype=np.float64), about)


BLOCKS = 12
LASERS = 16
FLAG = 0xEEFF
BANK_FLAGS = (FLAG, 0xDDFF, 0xCCFF, 0xBBFF)
"""Flags that mark blocks of lasers 0-31, 32-63, 64-95 and 96-127."""
DISTANCE_UNIT_M = 0.002
HOUR_S = 3600.0
STRONGEST_MODE, LAST_MODE, DUAL_MODE = 0x37, 0x38, 0x39
MODES = {STRONGEST_MODE: "strongest", LAST_MODE: "last", DUAL_MODE: "dual"}
HDL64E, VLS128 = 0x63, 0xA1
"""Product codes. HDL64E is this package's own, since packets of an HDL-64E state no product."""
PRODUCTS = {
    0x21: "HDL-32E",
    0x22: "VLP-16",
    0x24: "Puck Hi-Res",
    0x28: "VLP-32C",
    0x31: "Velarray",
    HDL64E: "HDL-64E",
    VLS128: "Alpha Prime (VLS-128)",
}
VLP16 = 0x22
RETURN = np.dtype([("distance", "<u2"), ("reflectivity", "u1")])
BLOCK = np.dtype([("flag", "<u2"), ("azimuth", "<u2"), ("returns", RETURN, (2, LASERS))])
PACKET = np.dtype(
    [("blocks", BLOCK, BLOCKS), ("time_us", "<u4"), ("mode", "u1"), ("product", "u1")]
)
SCAN = "velodyne_msgs/msg/VelodyneScan"
"""Type of the ROS messages that hold packets. `MESSAGES` has definitions in ROS's notation."""
MESSAGES = {
    "velodyne_msgs/msg/VelodynePacket": "builtin_interfaces/Time stamp\nuint8[1206] data",
    SCAN: "std_msgs/Header header\nvelodyne_msgs/VelodynePacket[] packets",
}
