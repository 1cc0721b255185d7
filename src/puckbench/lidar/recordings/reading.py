"""Recordings of real sensors, whatever their files' format, as packets, turns or a table."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Protocol

from puckbench.core.errors import InputError, naming
from puckbench.core.files import read_bytes
from puckbench.core.registry import Registry
from puckbench.io.recordings.pcap import read_datagrams
from puckbench.io.recordings.ros_bags import bag_format, read_messages
from puckbench.lidar.recordings.decoded_clouds import SUFFIXES, read_points
from puckbench.lidar.recordings.packet_turns import is_whole, returns_of_packets
from puckbench.lidar.recordings.packets import PACKET_BYTES, PacketLog, decode_packets, joined
from puckbench.lidar.recordings.returns import RecordedReturns, read_returns
from puckbench.lidar.returns import Returns
from puckbench.lidar.sensor import Sensor

SCAN = "velodyne_msgs/msg/VelodyneScan"
MESSAGES = {
    "velodyne_msgs/msg/VelodynePacket": "builtin_interfaces/Time stamp\nuint8[1206] data",
    SCAN: "std_msgs/Header header\nvelodyne_msgs/VelodynePacket[] packets",
}
"""Messages of the ROS driver velodyne_msgs, in ROS's notation."""


class Restore(Protocol):
    """What restores a compressed recording."""

    def __call__(self, path: Path, out: Path) -> object:
        """Write the recording of `path` to `out`; InputError where it is damaged."""


RECORDING_COMPRESSIONS: Registry[Restore] = Registry("recording compression", "codecs/puck")
"""Functions that restore compressed recordings, by the letters that these begin with."""


def read_recording(
    path: Path,
    sensor: Sensor | None = None,
    start_s: float = 0.0,
    end_s: float = math.inf,
) -> RecordedReturns:
    """Read the returns of a packet capture, a ROS bag, a decoded cloud or a table of returns.

    Parameters
    ----------
    path
        A packet capture (.pcap, .pcapng), a ROS bag (.bag, .db3, .mcap, or its folder), a cloud
        with the laser of each point (.csv, .ply, .pcd, .las, .laz; see
        `decoded_clouds.read_points`), or a table that `write_returns` wrote (.parquet).
    sensor
        None for the one that the packets name; a table has its own.
    start_s, end_s
        The interval to read, in seconds after the first packet (or point).

    Returns
    -------
    RecordedReturns
        `about` has the format and what was left aside: `other_packets`, `bytes_cut_off`.

    Raises
    ------
    InputError
        One line that names the file, when it holds no readable data of a VLP-16 or a
        Puck Hi-Res.
    """
    try:
        if path.suffix.lower() == ".parquet":
            table = _between(read_returns(path), start_s, end_s)
        elif path.suffix.lower() in SUFFIXES:
            table = _between(read_points(path, sensor), start_s, end_s)
        else:
            log = read_packets(path).between(start_s, end_s)
            decoded = decode_packets(log.payloads, sensor)
            table = replace(decoded, about={**decoded.about, **log.about})
        if len(table) == 0:
            raise InputError("no return in the recording")
    except InputError as error:
        raise error if str(path) in str(error) else InputError(f"{path}: {error}") from error
    return replace(table, about={**table.about, "source": path.name})


def read_turns(path: Path, start_s: float = 0.0) -> tuple[Returns, dict[str, int]]:
    """The turns of a recording, and counts of what was left out of them.

    Packets that are damaged are left out and counted as `damaged_packets`, and the bytes of a last
    one that is not whole as `bytes_cut_off`; only counts above 0 are told.

    Parameters
    ----------
    path
        As of `read_packets`.
    start_s
        Seconds to leave out at the start.

    Raises
    ------
    InputError
        One line that names the file, when it holds no turns of one known sensor and return mode.
    """
    with naming(path):
        log = read_packets(path).between(start_s, math.inf)
        whole = is_whole(log.payloads)
        if len(log) and not whole.any():
            raise InputError(f"none of its {len(log)} data packets has the flags of a Velodyne's")
        counts = {
            "damaged_packets": int((~whole).sum()),
            "bytes_cut_off": int(log.about.get("bytes_cut_off", 0)),
        }
        left_out = {name: count for name, count in counts.items() if count}
        return returns_of_packets(log.payloads[whole]), left_out


def read_packets(path: Path) -> PacketLog:
    """Data packets of a recording, compressed or not.

    The format is known by its first bytes, not by its name.
    """
    if path.is_dir():
        return _packets_of_bag(path)
    data = read_bytes(path)
    letters = data[:4].decode("ascii", "replace")
    if letters.isalpha() and letters in RECORDING_COMPRESSIONS:
        with TemporaryDirectory() as folder:
            restored = Path(folder, "recording")
            RECORDING_COMPRESSIONS.get(letters)(path, restored)
            with restored.open("rb") as file:
                if file.read(len(letters)) == data[: len(letters)]:
                    raise InputError("a compressed recording within another; decompress it first")
            return read_packets(restored)
    return _packets_of_bag(path) if bag_format(data) else packets_of_capture(data)


def packets_of_capture(data: bytes) -> PacketLog:
    """Data packets of a packet capture's bytes.

    Packets of other sizes (the sensor's position packets among them) are counted in `about` as
    `other_packets`, bytes of a last packet that is not whole as `bytes_cut_off`.

    Raises
    ------
    InputError
        For another format, or data packets from several senders.
    """
    recording = read_datagrams(data)
    packets = [one for one in recording.datagrams if len(one.payload) == PACKET_BYTES]
    senders = sorted({one.sender for one in packets})
    if len(senders) > 1:
        names = ", ".join(senders[:4])
        raise InputError(f"data packets of {len(senders)} senders ({names}): keep one of them")
    others = recording.others + len(recording.datagrams) - len(packets)
    about = {"format": "pcap", "other_packets": others, "bytes_cut_off": recording.bytes_cut_off}
    return joined([one.payload for one in packets], [one.received for one in packets], about)


def _packets_of_bag(path: Path) -> PacketLog:
    """Data packets of a bag's VelodyneScan messages, in the order of the messages."""
    bag = read_messages(path, SCAN, MESSAGES)
    packets = [packet for message in bag.messages for packet in message.packets]
    if not packets:
        raise InputError("the ROS bag has no data packet of a Velodyne")
    received = [one.stamp.sec + one.stamp.nanosec * 1e-9 for one in packets]
    about = {"format": bag.format, "topic": bag.topic, "messages": len(bag.messages)}
    return joined([one.data.tobytes() for one in packets], received, about)


def _between(table: RecordedReturns, start_s: float, end_s: float) -> RecordedReturns:
    """Rows from `start_s` to before `end_s` seconds after the first one."""
    since = table["timestamp"] - table["timestamp"].min(initial=math.inf)
    return table.select((since >= start_s) & (since < end_s))
