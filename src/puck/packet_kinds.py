"""Formats of packets in recordings, and conversion between packets and records of a stream.

A turn, i.e. the packets of one revolution, is one record. A second record follows if the packets
hold more data than the turn: an Ouster's further fields, an HDL-64E's status bytes, or an Alpha
Prime's blocks without lasers in dual return mode.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from itertools import accumulate, pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointkit.coding.byte_io import Reader
from pointkit.errors import InputError
from pointkit.lidar.turns import Turn
from puck.fields import FieldsDecoder, FieldsEncoder
from puck.gaps import compress_bytes, decompress_bytes
from puck.options import CodingOptions
from puck.recordings.clock_leaps import Motion, motion_of
from puck.recordings.ouster import OusterSensor
from puck.recordings.ouster_packets import OusterKind
from puck.recordings.packet_turns import (
    PacketKind,
    Payloads,
    find_packets,
    kind_codes,
    packet_kind,
    packets_of,
    split_turns,
    turn_of,
)
from puck.recordings.packets import PACKET, PACKET_BYTES
from puck.records import (
    DAMAGED,
    Record,
    RecordKind,
    check,
    count_ranges,
)
from puck.returns_header import decode_layout, encode_layout
from puck.turns import TurnDecoder, TurnEncoder, is_key

Kind = PacketKind | OusterKind
_OUSTER_CODE_BYTES = 3


class PacketFormat(NamedTuple):
    """Format of packets in a file: fragments of lengths `pieces`, which are `hole` bytes apart.

    They are packets of the Ouster `sensor`; if it is None, of any Velodyne.
    """

    pieces: list[int]
    hole: int
    find: Callable[[Payloads], NDArray[np.int64]]
    split_turns: Callable[[Payloads], Iterator[tuple[Kind, Payloads]]]
    sensor: OusterSensor | None = None

    @property
    def packet(self) -> np.dtype[Any]:
        """NumPy structure of a packet."""
        return self.sensor.packet if self.sensor else PACKET

    @property
    def span(self) -> int:
        """Number of bytes in the file from the first to the last byte of a packet."""
        return sum(self.pieces) + self.hole * (len(self.pieces) - 1)

    @property
    def starts(self) -> NDArray[np.int64]:
        """Offset of each fragment from the first byte of the packet in the file."""
        steps = np.array(self.pieces) + self.hole
        starts: NDArray[np.int64] = np.cumsum(steps) - steps
        return starts

    def motion(self, payloads: Payloads) -> Motion:
        """Return the motion of the sensor between packets (p, bytes)."""
        return motion_of(payloads, self.packet, self.sensor.columns if self.sensor else 0)

    def products(self, payloads: Payloads) -> NDArray[np.uint8]:
        """Return the product code (p,) in each of a Velodyne's packets; 0 for an Ouster's."""
        if self.sensor is None:
            return kind_codes(payloads)[:, 0].astype(np.uint8)
        return np.zeros(len(payloads), np.uint8)


VELODYNE = PacketFormat([PACKET_BYTES], 0, find_packets, split_turns)
_HOLES = (50, 52, 54, 68)
"""Bytes of headers between IP fragments: pcap (Ethernet, Linux cooked, VLAN) and pcapng."""


def formats_of(sensors: Iterable[OusterSensor]) -> list[PacketFormat]:
    """Return the formats of packets to search for in a recording, in the order of the search.

    The formats of the Ouster `sensors` come first; those of all Velodynes follow.
    """
    formats = []
    for sensor in sensors:
        whole = OusterKind.of(sensor)
        fragmented = (replace(whole, is_fragmented=True, hole=hole) for hole in _HOLES)
        kinds = [whole, *(each for each in fragmented if len(each.pieces) > 1)]
        formats += [
            PacketFormat(each.pieces, each.hole, each.find, each.split_turns, sensor)
            for each in kinds
        ]
    return [*formats, VELODYNE]


def decode_kind(body: bytes) -> Kind:
    """Return the kind of packets that the body of a LAYOUT record describes.

    Raises InputError if no packets have this layout.
    """
    layout, code = decode_layout(body)
    if len(code) == _OUSTER_CODE_BYTES:
        return OusterKind.decode(layout, code)
    if len(code) != 2:
        raise InputError("the stream holds turns, but no packets")
    kind = packet_kind(*code)
    # The stream has its own order and shifts of lasers, as the tables of sensors may change.
    check(layout == replace(kind.layout, order=layout.order, shifts=layout.shifts))
    return replace(kind, layout=layout)


def count_values(kind: Kind, body: bytes) -> int:
    """Return the number of ranges plus the number of further field values in a coded turn."""
    images = len(kind.channels) if isinstance(kind, OusterKind) else 0
    return count_ranges(kind.layout, body) * (1 + images)


class PacketsEncoder:
    """Encoder that converts the packets of successive turns to records of a stream.

    All packets are of one kind, i.e. of one sensor and return mode.
    """

    def __init__(self, kind: Kind, options: CodingOptions) -> None:
        is_quick = options.effort == "fast" and isinstance(kind, OusterKind)
        self.kind, self._turns = kind, TurnEncoder(kind.layout, options, is_quick=is_quick)
        self._effort = options.effort
        self._fields: FieldsEncoder | None = None

    def layout(self) -> Record:
        """Return the LAYOUT record, which must precede the records of all turns in a stream."""
        kind = self.kind
        code = kind.code if isinstance(kind, OusterKind) else bytes([kind.product, kind.mode])
        return Record(RecordKind.LAYOUT, encode_layout(kind.layout) + code)

    def encode(self, payloads: Payloads) -> tuple[Turn, list[Record]]:
        """Encode the packets (p, bytes) of one turn.

        Returns
        -------
        turn
            The turn that the packets form.
        records
            The turn's record, and a second one if the packets hold more data than the turn.
        """
        kind = self.kind
        if isinstance(kind, PacketKind):
            turn = turn_of(kind, payloads)
            records = [Record(RecordKind.TURN, self._turns.encode(turn))]
            rest = np.ascontiguousarray(payloads[:, kind.rest].T)
            if kind.has_rest:
                records.append(Record(RecordKind.FIELDS, compress_bytes(rest.tobytes())))
            return turn, records
        turn = kind.turn_of(payloads)
        body = self._turns.encode(turn)
        self._fields = self._fields or FieldsEncoder(kind, self._effort)
        fields = self._fields.encode(turn, kind.rest_of(payloads), is_key=is_key(body))
        return turn, [Record(RecordKind.TURN, body), Record(RecordKind.FIELDS, fields)]


class PacketsDecoder:
    """Decoder that converts the records of a `PacketsEncoder` back to packets.

    Call a method for each record in the order of the stream, and `take` to get the packets.
    InputError is raised if packets that are not yet taken exceed `most_bytes`.
    """

    def __init__(self, most_bytes: int) -> None:
        self._most_bytes, self._bytes, self._count = most_bytes, 0, 0
        self._pieces: list[bytes] = []
        self._kind: Kind | None = None
        self._turn: Turn | None = None  # whose fields must follow
        self._is_key = False

    def start_layout(self, body: bytes) -> None:
        """Begin turns of another kind of packets, which the body of a LAYOUT record describes."""
        check(self._turn is None)
        self._kind = kind = decode_kind(body)
        self._turns = TurnDecoder(kind.layout)
        self._fields = FieldsDecoder(kind) if isinstance(kind, OusterKind) else None

    def add_turn(self, body: bytes) -> int:
        """Decode the body of a turn's record, and return the number of the turn's returns."""
        kind = self._kind
        if kind is None or self._turn is not None:
            raise InputError(DAMAGED)
        turn = self._turns.decode(body)
        if isinstance(kind, PacketKind) and not kind.has_rest:
            self._keep(packets_of(kind, turn), VELODYNE.pieces)
        else:
            self._turn, self._is_key = turn, is_key(body)
        return turn.returns

    def add_fields(self, body: bytes) -> None:
        """Decode a FIELDS record's body, the data of the last packets beyond the turn."""
        kind, turn, self._turn = self._kind, self._turn, None
        if kind is None or turn is None:
            raise InputError(DAMAGED)
        if isinstance(kind, PacketKind):
            self._keep(packets_of(kind, turn, _decode_rest(kind, turn, body)), VELODYNE.pieces)
        elif self._fields:
            fields = self._fields.decode(body, turn, is_key=self._is_key)
            self._keep(kind.packets_of(turn, fields), kind.pieces)

    def _keep(self, payloads: Payloads, pieces: list[int]) -> None:
        self._count, self._bytes = self._count + len(payloads), self._bytes + payloads.size
        check(self._bytes <= self._most_bytes)
        edges = list(pairwise(accumulate(pieces, initial=0)))
        self._pieces += [row[at:end].tobytes() for row in payloads for at, end in edges]

    def take(self) -> tuple[int, list[bytes]]:
        """Return the packets that were decoded since the last call.

        Returns
        -------
        count
            Number of packets.
        pieces
            The bytes of the packets, with one item for each fragment of a packet.
        """
        check(self._turn is None)
        count, pieces = self._count, self._pieces
        self._count, self._bytes, self._pieces = 0, 0, []
        return count, pieces


def _decode_rest(kind: PacketKind, turn: Turn, body: bytes) -> Payloads:
    packets, uneven = divmod(len(turn.azimuths), kind.layout.blocks_per_time)
    check(not uneven)
    expected = packets * (kind.rest.stop - kind.rest.start)
    raw = decompress_bytes(Reader(body), lambda size: check(size == expected))
    rest = np.frombuffer(raw, np.uint8)
    return rest.reshape(-1, packets).T
