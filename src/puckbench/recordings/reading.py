from __future__ import annotations

import logging
import math
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pointkit.errors import InputError, naming
from pointkit.files import read_bytes
from pointkit.lidar.return_table import ReturnTable, read_return_table
from pointkit.lidar.returns import HOUR_US, Returns
from pointkit.lidar.sensor import Sensor
from pointkit.lidar.sensors import load_sensor
from pointkit.lidar.times import TimeUnit
from pointkit.lidar.turns import elapsed
from pointkit.lidar.unit_calibration import calibration_beside, calibration_in_packets, is_s3
from puck.recordings.captured_packets import is_packet_capture
from puck.recordings.clock_leaps import packet_steps
from puck.recordings.data_packets import (
    LEFT_OUT,
    log_left_out,
    ouster_packets,
    packets_of_capture,
    whole_packets,
)
from puck.recordings.ouster import is_osf, osf_advice, ouster_turns
from puck.recordings.ouster_bags import PACKET_MESSAGES, ouster_packets_in_bag
from puck.recordings.ouster_tables import ouster_table
from puck.recordings.packet_order import (
    in_order,
    tell_irregularities,
    without_leaps,
)
from puck.recordings.packet_turns import SENSORS, decode_packets, kind_codes, returns_of_packets
from puck.recordings.packets import HDL64E, MESSAGES, PACKET, SCAN, PacketLog
from puck.recordings.pcap import Capture, read_datagrams, refuse_stream
from puck.recordings.ros_bags import is_bag, read_messages, read_topics
from puck.recordings.topics import refuse_topic
from puckbench.recordings.cloud_messages import has_clouds
from puckbench.recordings.decoded_clouds import SUFFIXES, read_points
from puckbench.recordings.message_returns import read_message_returns

_COMPRESSED = {
    b"\x1f\x8b": "gzip",
    b"BZh": "bzip2",
    b"PK\x03\x04": "ZIP",
    b"\xfd7zXZ": "xz",
    b"\x28\xb5\x2f\xfd": "Zstandard",
}
"""Names of compression formats, by the first bytes of a file."""


def read_recording(
    path: Path,
    sensor: Sensor | None = None,
    start_s: float = 0.0,
    end_s: float = math.inf,
    stream: str | None = None,
    time_unit: TimeUnit | None = None,
    source: Path | None = None,
    topic: str | None = None,
) -> ReturnTable:
    """Read the returns of a LiDAR recording as a table.

    Parameters
    ----------
    path
        A packet capture (.pcap, .pcapng), a ROS bag of data packets or clouds (.bag, .db3, .mcap,
        or its folder), a cloud (see `decoded_clouds.read_points`), or a Parquet file of a
        `ReturnTable`.
    sensor
        The sensor; by default, it is inferred. It must be None for packets of an Ouster, which
        describe their sensor.
    start_s, end_s
        Interval to read, in seconds after the first packet or point. Times in the table count from
        there, too, whatever the interval.
    stream
        Stream of a packet capture, such as ``192.168.1.201:2368``; by default, the only one.
    time_unit
        Unit of the times of a cloud; by default, it is inferred.
    source
        File that messages name, if `path` is a temporary copy of it.
    topic
        Topic of a ROS bag; by default, the only one with packets or clouds.

    Returns
    -------
    ReturnTable
        A row for each return.

    Raises
    ------
    InputError
        The file is not a recording, an option does not suit its kind, or it has no return.
    """
    source, suffix = source or path, path.suffix.lower()
    with naming(source):
        is_file_of_returns = suffix in (*SUFFIXES, ".parquet")
        if is_file_of_returns:
            refuse_stream(stream)
        has_units = suffix in SUFFIXES or (not is_file_of_returns and has_clouds(path, topic))
        if time_unit is not None and not has_units:
            raise InputError(f"time unit {time_unit}: only times of clouds have units")
        if is_file_of_returns:
            refuse_topic(topic)
        if suffix == ".parquet":
            table = _between(read_return_table(path), start_s, end_s)
        elif suffix in SUFFIXES:
            table = _between(read_points(path, sensor, time_unit), start_s, end_s)
        elif has_units:
            returns = read_message_returns(path, topic, sensor, time_unit, source)
            table = _between(returns, start_s, end_s)
        else:
            packets = read_packets(path, stream, source, topic)
            sensor = sensor or _unit(packets, source)
            log = _interval(packets, start_s, end_s)
            decoded = _decoded(log, sensor)
            times = decoded["timestamp"] + _since_first_s(packets, log)
            columns = {**decoded.columns, "timestamp": times}
            table = replace(decoded, columns=columns, about={**decoded.about, **log.about})
        if len(table) == 0:
            raise InputError("no return in the recording")
    return replace(table, about={**table.about, "source": source.name})


class RecordedTurns(NamedTuple):
    """The turns of a recording, i.e. the revolutions of the sensor, as `read_turns` returns them.

    Parameters
    ----------
    returns
        All turns, including incomplete ones.
    whole
        Numbers of the complete turns in `returns`.
    left_out
        Counts of data that were left out, by name.
    begun_s
        Time since 1970, in s, at which the first turn in `returns` began, i.e. its first packet was
        received. None if it is unknown.
    """

    returns: Returns
    whole: range
    left_out: dict[str, int]
    begun_s: float | None

    def time_s(self, turn: int) -> float | None:
        """Return the time since 1970, in s, at which a turn began, or None if it is unknown."""
        if self.begun_s is None:
            return None
        clocks = [each.times for each in self.returns.turns[: turn + 1]]
        begun_us = np.array([float(clock[0]) for clock in clocks if clock is not None])
        return self.begun_s + float(elapsed(begun_us, HOUR_US)[-1]) * 1e-6

    @property
    def seconds(self) -> float | None:
        """Duration of the complete turns, in s; None if their times are unknown."""
        first, last = self.whole.start, min(self.whole.stop, len(self.returns.turns) - 1)
        if last <= first or any(turn.times is None for turn in self.returns.turns):
            return None
        begun, ended = self.time_s(first), self.time_s(last)
        if begun is None or ended is None:
            return None
        return (ended - begun) * len(self.whole) / (last - first)


def read_turns(
    path: Path,
    start_s: float = 0.0,
    stream: str | None = None,
    source: Path | None = None,
    topic: str | None = None,
) -> RecordedTurns:
    """Read the turns of a recording of packets, with the values that the sensor reported.

    Parameters
    ----------
    path
        A packet capture or a ROS bag of packets.
    start_s
        Beginning of the part to read, in seconds after the first packet.
    stream, source, topic
        As for `read_packets`.
    """
    with naming(source or path):
        packets = read_packets(path, stream, source, topic)
        log = _interval(packets, start_s, math.inf)
        return turns_of_packets(log, source or path, packets)


def turns_of_packets(
    log: PacketLog, source: Path, calibrating: PacketLog | None = None
) -> RecordedTurns:
    """Decode packets to turns.

    Parameters
    ----------
    log
        The packets.
    source
        Path of the recording, beside which a calibration may lie.
    calibrating
        Packets from which the calibration of an HDL-64E is read; by default, those of `log`.
    """
    left_out = {name: int(log.about[name]) for name in LEFT_OUT if log.about.get(name)}
    begun_s = float(log.received.min())
    if log.sensor:
        return RecordedTurns(*ouster_turns(log.sensor, log.payloads), left_out, begun_s)
    returns = returns_of_packets(log.payloads, _unit(calibrating or log, source))
    return RecordedTurns(returns, range(1, len(returns.turns) - 1), left_out, begun_s)


def read_packets(
    path: Path, stream: str | None = None, source: Path | None = None, topic: str | None = None
) -> PacketLog:
    """Read the undamaged data packets of a packet capture or a ROS bag, in the sensor's order.

    Warnings tell of packets that are left out, late or lost, and of leaps of clock and azimuth. The
    packets' clock goes on without its leaps.

    Parameters
    ----------
    path
        The capture or bag.
    stream
        Stream of a capture, such as ``192.168.1.201:2368``; by default, the only one.
    source
        File that messages name, if `path` is a temporary copy of it.
    topic
        Topic of a bag; by default, the only one with packets.

    Raises
    ------
    InputError
        The file is neither a capture nor a bag, it has no data packets, or it has several streams
        or topics and none is chosen.
    """
    source = source or path
    with naming(source):
        if is_bag(path):
            log = _packets_of_bag(path, stream, topic, source)
        else:
            log = _packets_of_file(path, stream, topic, source)
        log_left_out(source, log.about)
        log = in_order(log)
        tell_irregularities(source, log)
    return without_leaps(log)


def _packets_of_file(path: Path, stream: str | None, topic: str | None, source: Path) -> PacketLog:
    capture = _capture(path, topic)
    return ouster_packets(capture, path, source, stream) or packets_of_capture(capture, stream)


def _capture(path: Path, topic: str | None) -> Capture:
    data = read_bytes(path)
    if not is_packet_capture(data):
        raise InputError(_unknown_format(path, data))
    refuse_topic(topic)
    return read_datagrams(data)


def _unknown_format(path: Path, data: bytes) -> str:
    if is_osf(data):
        return osf_advice(path)
    packer = next((name for start, name in _COMPRESSED.items() if data.startswith(start)), None)
    hint = f"packed by {packer}: unpack it" if packer else "clouds and tables go by their suffixes"
    return f"not a packet capture (.pcap, .pcapng) or ROS bag (.bag, .db3, .mcap); {hint}"


def _packets_of_bag(path: Path, stream: str | None, topic: str | None, source: Path) -> PacketLog:
    refuse_stream(stream)
    topics = read_topics(path)
    kinds = {each.kind for name, each in topics.items() if topic in (None, name)}
    if SCAN not in kinds and not kinds.isdisjoint(PACKET_MESSAGES):
        return ouster_packets_in_bag(path, topics, source, topic)
    bag = read_messages(path, [SCAN, *PACKET_MESSAGES], MESSAGES, topic)
    packets = [packet for message in bag.messages for packet in message.packets]
    if not packets:
        raise InputError("the ROS bag has no data packet of a Velodyne")
    received = [packet.stamp.sec + packet.stamp.nanosec * 1e-9 for packet in packets]
    about = {"format": bag.format, "topic": bag.topic, "messages": len(bag.messages)}
    return whole_packets([packet.data.tobytes() for packet in packets], received, about)


def _decoded(log: PacketLog, sensor: Sensor | None) -> ReturnTable:
    if log.sensor is None:
        return decode_packets(log.payloads, sensor)
    if sensor:
        raise InputError(f"sensor {sensor.name}: the metadata of an Ouster describe its sensor")
    return ouster_table(log.sensor, log.payloads)


def _unit(log: PacketLog, source: Path) -> Sensor | None:
    """Return the HDL-64E of a recording, calibrated if possible, or None if it is another sensor.

    The calibration comes from a file beside the recording or from the packets.
    """
    if log.sensor or kind_codes(log.payloads[:1])[0, 0] != HDL64E:
        return None
    status = log.payloads[:, -2:]
    sensor = nominal = load_sensor(SENSORS[HDL64E])
    if beside := calibration_beside(source):
        sensor = load_sensor(beside)
    elif calibration := calibration_in_packets(status):
        sensor = nominal.replaced(**calibration)
    else:
        logging.getLogger(__name__).warning(
            "%s: nominal angles and distances of an HDL-64E's lasers; put the calibration of the "
            "unit (db.xml) beside it as %s",
            source,
            source.with_suffix(".xml").name,
        )
    if sensor.name != nominal.name or is_s3(status):
        return sensor
    older = load_sensor("hdl64e_s2")
    changes = ("name", "azimuth_step_deg", "firing_sequence_us", "firing_offsets_us")
    return sensor.replaced(**{name: getattr(older, name) for name in changes})


def _interval(log: PacketLog, start_s: float, end_s: float) -> PacketLog:
    selected = log.between(start_s, end_s)
    if not len(selected):
        last = log.received[-1] - log.received[0]
        raise InputError(
            f"no data packet from {start_s:g} to {end_s:g} s; the last is at {last:g} s"
        )
    return selected


def _since_first_s(packets: PacketLog, selected: PacketLog) -> float:
    """Return the time from the first packet to the first selected one, in s, by their clock."""
    before = int(np.argmax(packets.received == selected.received[0]))
    kind = PACKET if packets.sensor is None else packets.sensor.packet
    return float(packet_steps(packets.payloads[: before + 1], kind).sum()) * 1e-6


def _between(table: ReturnTable, start_s: float, end_s: float) -> ReturnTable:
    since = table["timestamp"] - table["timestamp"].min(initial=math.inf)
    return table.select((since >= start_s) & (since < end_s))
