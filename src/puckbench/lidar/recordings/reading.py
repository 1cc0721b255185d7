"""A capture of a real VLP-16 by its file, whatever the format: its returns as a table."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

from puckbench.core.errors import InputError
from puckbench.core.files import read_bytes
from puckbench.io.recordings.packet_log import PacketLog
from puckbench.io.recordings.pcap import read_pcap
from puckbench.io.recordings.ros_bags import SQLITE, read_ros2bag
from puckbench.lidar.recordings.capture_table import CaptureTable, read_capture_table
from puckbench.lidar.recordings.decoded_clouds import SUFFIXES, read_points
from puckbench.lidar.recordings.packets import decode_packets
from puckbench.lidar.sensor import Sensor


def read_capture(
    path: Path,
    sensor: Sensor | None = None,
    start_s: float = 0.0,
    end_s: float = math.inf,
) -> CaptureTable:
    """Returns of a packet capture (.pcap), a ROS 2 bag (.db3, or its folder), a cloud or a table.

    A cloud (.csv, .ply, .pcd) must tell each point's laser: see `pointfiles.read_points`. A table
    (.parquet) is one that `write_capture_table` wrote; it has its sensor.
    start_s, end_s: the interval to read, in seconds after the first packet (or point). `about`
    tells the format and what was left aside: `other_packets`, `bytes_cut_off` of a truncated file.

    Raises InputError, one line that names the file, when it holds no readable VLP-16 data.
    """
    try:
        if path.suffix.lower() == ".parquet":
            table = _between(read_capture_table(path), start_s, end_s)
        elif path.suffix.lower() in SUFFIXES:
            table = _between(read_points(path, sensor), start_s, end_s)
        else:
            log = read_packets(path).between(start_s, end_s)
            decoded = decode_packets(log.payloads, sensor)
            table = replace(decoded, about={**decoded.about, **log.about})
        if len(table) == 0:
            raise InputError("no return in the capture")
    except InputError as error:
        raise error if str(path) in str(error) else InputError(f"{path}: {error}") from error
    return replace(table, about={**table.about, "source": path.name})


def read_packets(path: Path) -> PacketLog:
    """Data packets of a capture file; the format is told by its first bytes, not its name."""
    if path.is_dir():
        path = _bag_in(path)
    data = read_bytes(path)
    if data.startswith(SQLITE):
        return read_ros2bag(path)
    return read_pcap(data)


def _between(table: CaptureTable, start_s: float, end_s: float) -> CaptureTable:
    """Rows from `start_s` to before `end_s` seconds after the first one."""
    since = table["timestamp"] - table["timestamp"].min(initial=math.inf)
    return table.select((since >= start_s) & (since < end_s))


def _bag_in(folder: Path) -> Path:
    bags = sorted(folder.glob("*.db3"))
    if len(bags) != 1:
        raise InputError(f"{folder}: {len(bags)} .db3 files, where one is expected")
    return bags[0]
