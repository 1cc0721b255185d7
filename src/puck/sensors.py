"""Separation of a recording's packets by sensor, and sorting of each sensor's packets by its clock.

The packets of each sensor are encoded as turns of their own. An ORDER record restores the order in
which the packets lie in the recording.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointkit.coding.byte_io import Reader
from puck.gaps import Bytes, compress_bytes, decompress_bytes
from puck.packet_kinds import PacketFormat, PacketsDecoder
from puck.recordings.packet_order import sorted_rows
from puck.recordings.packet_turns import Payloads
from puck.records import Record, RecordKind, check

_MOST_SENSORS = 16
"""Maximum number of sensors that are told apart, since each needs memory."""
_HEADERS = 48
"""Number of bytes of an IPv6 header and a UDP header, which is more than with IPv4."""
_UDP, _UDP_BYTES = 17, 8
_SHIFT = np.dtype("<i4")


class LocatedPackets(NamedTuple):
    """Packets of one format in a part of a recording: their places (p,) and contents (p, bytes)."""

    format: PacketFormat
    places: NDArray[np.int64]
    payloads: Payloads


class SensorPackets(NamedTuple):
    """Packets of one sensor: number of their format in a list, and their indices in its packets."""

    format: int
    rows: NDArray[np.intp]


class SortedPackets(NamedTuple):
    """Packets of a part of a recording by sensor.

    Parameters
    ----------
    by_sensor
        Packets of each sensor, in the order of the sensor's clock, by its number.
    order
        Body of the ORDER record; None if the recording has the packets in this order.
    formats
        Numbers of the formats whose packets are among them, as there may be too many sensors.
    """

    by_sensor: dict[int, SensorPackets]
    order: bytes | None
    formats: list[int]


class PacketSorter:
    """Sorts the packets of successive parts of a recording by sensor and by the sensor's clock.

    A sensor is known by the addresses and ports of its packets, if they have headers of IP and UDP,
    by its product, and by the format of its packets.
    """

    def __init__(self) -> None:
        self._numbers: dict[bytes, int] = {}
        self._last: dict[bytes, int] = {}

    def sort(self, content: Bytes, found: Sequence[LocatedPackets]) -> SortedPackets:
        """Sort packets of several formats, which were found in a part's content."""
        by_sensor = dict[int, SensorPackets]()
        formats, all_places, all_sensors, all_shifts = list[int](), [], [], []
        for k, (form, places, payloads) in enumerate(found):
            sensors = self._sensors(content, found[k])
            if sensors is None:
                continue
            shifts = np.zeros(len(sensors), _SHIFT)
            for number in np.unique(sensors).tolist():
                rows = np.flatnonzero(sensors == number)
                in_order = sorted_rows(form.motion(payloads[rows]))
                if in_order is not None:
                    shifts[rows] = np.argsort(in_order) - np.arange(len(rows))
                    rows = rows[in_order]
                by_sensor[number] = SensorPackets(k, rows)
            formats.append(k)
            all_places.append(places)
            all_sensors.append(sensors)
            all_shifts.append(shifts)
        if not formats:
            return SortedPackets({}, None, [])
        recorded = np.argsort(np.concatenate(all_places), kind="stable")
        shifts = np.concatenate(all_shifts)[recorded]
        is_sorted = not any(by_sensor) and not shifts.any()
        order = np.concatenate(all_sensors)[recorded].tobytes() + shifts.tobytes()
        return SortedPackets(by_sensor, None if is_sorted else compress_bytes(order), formats)

    def _sensors(self, content: Bytes, found: LocatedPackets) -> NDArray[np.uint8] | None:
        """Return the number of each packet's sensor (p,), or None if none is left for a format."""
        form, places, payloads = found
        of_format = np.array([form.span, form.hole], "<u4").tobytes()
        keys = np.concatenate(
            [_addresses(content, form, places), form.products(payloads)[:, None]], axis=1
        )
        present, first, inverse = np.unique(keys, axis=0, return_index=True, return_inverse=True)
        numbers = np.zeros(len(present), np.uint8)
        for k in np.argsort(first).tolist():
            key = of_format + present[k].tobytes()
            if key not in self._numbers:
                is_full = len(self._numbers) >= _MOST_SENSORS
                if is_full and of_format not in self._last:
                    return None
                number = self._last[of_format] if is_full else len(self._numbers)
                self._numbers[key] = self._last[of_format] = number
            numbers[k] = self._numbers[key]
        return numbers[inverse.reshape(-1)]


def _addresses(content: Bytes, form: PacketFormat, places: NDArray[np.int64]) -> Bytes:
    """Return the addresses and ports before each packet, (p, 36), or zeros if there are none."""
    heads = content[np.maximum(places - _HEADERS, 0)[:, None] + np.arange(_HEADERS)]
    length = heads[:, -4] * np.int64(256) + heads[:, -3]
    is_udp = (length == sum(form.pieces) + _UDP_BYTES) & (places >= _HEADERS)
    is_v4 = is_udp & (heads[:, 20] == 0x45) & (heads[:, 29] == _UDP)
    is_v6 = is_udp & (heads[:, 0] >> 4 == 6) & (heads[:, 6] == _UDP)
    addresses = np.zeros((len(places), 36), np.uint8)
    addresses[is_v6] = heads[is_v6, 8:44]
    addresses[is_v4, -12:] = heads[is_v4, 32:44]
    return addresses


def sensor_record(number: int) -> Record:
    """Return the SENSOR record that begins records of the sensor with a number."""
    return Record(RecordKind.SENSOR, bytes([number]))


def sensor_number(body: bytes) -> int:
    """Return the sensor's number in the body of a SENSOR record.

    Raises InputError if there is none.
    """
    check(len(body) == 1 and body[0] < _MOST_SENSORS)
    return body[0]


class SensorsDecoder:
    """Decoder that converts the records of several sensors' turns back to packets.

    InputError is raised if the packets of a sensor that are not yet taken exceed `most_bytes`.
    """

    def __init__(self, most_bytes: int) -> None:
        self._most_bytes, self._order = most_bytes, b""
        self._decoders = {0: PacketsDecoder(most_bytes)}
        self._selected = self._decoders[0]

    def add(self, record: Record) -> int:
        """Decode a record that precedes a GAPS record, and return its number of returns."""
        if record.kind == RecordKind.SENSOR:
            number = sensor_number(record.body)
            decoder = self._decoders.setdefault(number, PacketsDecoder(self._most_bytes))
            self._selected = decoder
        elif record.kind == RecordKind.ORDER:
            self._order = record.body
        elif record.kind == RecordKind.LAYOUT:
            self._selected.start_layout(record.body)
        elif record.kind == RecordKind.FIELDS:
            self._selected.add_fields(record.body)
        else:
            return self._selected.add_turn(record.body)
        return 0

    def take(self) -> tuple[int, list[bytes]]:
        """Return number and pieces of the packets since the last call, as in the recording."""
        taken = {number: decoder.take() for number, decoder in self._decoders.items()}
        order, self._order = self._order, b""
        if order:
            return sum(count for count, _ in taken.values()), _in_recorded_order(order, taken)
        check(not any(count for number, (count, _) in taken.items() if number))
        return taken[0]


def _in_recorded_order(order: bytes, taken: Mapping[int, tuple[int, list[bytes]]]) -> list[bytes]:
    total = sum(count for count, _ in taken.values())
    expected = total * (1 + _SHIFT.itemsize)
    raw = decompress_bytes(Reader(order), lambda size: check(size == expected))
    sensors, shifts = np.frombuffer(raw, np.uint8, total), np.frombuffer(raw, _SHIFT, offset=total)
    ordered: list[list[bytes]] = [[] for _ in range(total)]
    for number, (count, pieces) in taken.items():
        rows = np.flatnonzero(sensors == number)
        places = np.arange(len(rows)) + shifts[rows]
        check(len(rows) == count and bool((np.sort(places) == np.arange(count)).all()))
        per_packet = len(pieces) // max(count, 1)
        for row, place in zip(rows.tolist(), places.tolist(), strict=True):
            ordered[row] = pieces[place * per_packet : (place + 1) * per_packet]
    return [piece for packet in ordered for piece in packet]
