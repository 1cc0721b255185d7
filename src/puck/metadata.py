"""Metadata of Ouster sensors in or beside a recording, and their use by a compressed recording."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import NamedTuple

from pointkit.errors import InputError
from pointkit.files import open_file, read_bytes
from puck.packet_kinds import PacketFormat, formats_of
from puck.recordings.captured_packets import START_BYTES, is_packet_capture
from puck.recordings.ouster import OusterSensor, all_metadata_beside, sensor_of
from puck.recordings.ouster_bags import sensors_in_bag
from puck.recordings.ouster_logs import find_contradiction
from puck.recordings.ros_bags import is_bag
from puck.sensors import LocatedPackets

MOST_METADATA = 1 << 18
"""Maximum size in bytes of the metadata of an Ouster in a stream."""
_log = logging.getLogger(__name__)


class Metadata(NamedTuple):
    """What is known of the Ouster sensors of a recording.

    Parameters
    ----------
    sensors
        The sensors, with different formats of packets.
    files
        The JSON files beside the recording that describe them, in the same order. There are none if
        metadata are in the recording itself, as in bags of the sensor's driver.
    content
        Content of the first of the files, which travels with the compressed recording; else empty.
    faults
        For each file without valid metadata, a line that says so.
    """

    sensors: list[OusterSensor]
    files: list[Path]
    content: bytes
    faults: list[str]


def read_metadata(recording: Path | None) -> Metadata:
    """Read the metadata of Ouster sensors in or beside a recording.

    `recording` is the path of the file; it is None for a recording that comes from a pipe.
    """
    found = Metadata([], [], b"", [])
    if recording is None:
        return found
    try:
        if is_bag(recording) and (sensors := sensors_in_bag(recording)):
            return found._replace(sensors=sensors)
    except InputError:
        pass
    for path in all_metadata_beside(recording):
        try:
            content = read_bytes(path)
            sensor = sensor_of(content, f"{path}")
        except InputError as error:
            found.faults.append(f"{error}")
            continue
        if sensor.packet not in [each.packet for each in found.sensors]:
            found.sensors.append(sensor)
            found.files.append(path)
            found = found if found.content else found._replace(content=content)
    return found


class MetadataUse:
    """Metadata that a recording's compression uses, and warnings about them.

    Parameters
    ----------
    recording
        Path of the recording, or None if it comes from a pipe.

    Attributes
    ----------
    formats
        Formats of packets to search for in the recording.
    """

    def __init__(self, recording: Path | None) -> None:
        self._recording, self._metadata = recording, read_metadata(recording)
        self._taken = set[int]() if self._metadata.files else {*range(len(self._metadata.sensors))}
        self.formats = formats_of(self._metadata.sensors)

    def describes(self, form: PacketFormat) -> bool:
        """Return whether packets of a format, which were not taken yet, have metadata of files."""
        return form.sensor is not None and self._number(form) not in self._taken

    def take(self, found: LocatedPackets) -> bytes:
        """Return the metadata that a stream must contain before packets, or no bytes.

        Metadata of files travel with the first packets that they describe. A warning tells if the
        packets contradict them, or if only metadata of another sensor travel.
        """
        number = self._number(found.format)
        self._taken.add(number)
        sensor, name = self._metadata.sensors[number], self._metadata.files[number].name
        contradiction = find_contradiction(sensor, found.payloads.view(found.format.packet)[:, 0])
        if contradiction is None and number == 0 and len(self._metadata.content) <= MOST_METADATA:
            return self._metadata.content
        if contradiction is None:
            self._tell(f"{name} is not stored with the packets that it describes: keep it")
        else:
            seen, stated = contradiction
            self._tell(f"{seen}, and {name} is of {stated}: it is not stored with them")
        return b""

    def tell_unused(self) -> None:
        """Warn of files without valid metadata, and of metadata that describe no packets.

        The warnings are about packet captures in which no packets were found.
        """
        if self._recording is None or not _is_capture(self._recording):
            return
        for fault in self._metadata.faults:
            _log.warning("%s: compressed without it", fault)
        for number, path in enumerate(self._metadata.files):
            if number not in self._taken:
                sensor = self._metadata.sensors[number]
                size = f"packets of {sensor.packet.itemsize:,} bytes"
                described = f"{path.name} ({sensor.name}, {sensor.profile}, {size})"
                self._tell(f"has no packets that {described} describes: compressed without it")

    def _number(self, form: PacketFormat) -> int:
        return [each is form.sensor for each in self._metadata.sensors].index(True)

    def _tell(self, text: str) -> None:
        _log.warning("%s: %s", self._recording, text)


def _is_capture(recording: Path) -> bool:
    with open_file(recording) as file:
        return is_packet_capture(file.read(START_BYTES))
