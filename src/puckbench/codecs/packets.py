"""The sensor's own data packets, packed as bytes: what archives of captures hold.

Reflectivities and times are in them, which codecs of ranges leave out unless they are asked. A
stream is framed (`common.framing`):

    the number of turns; the number of packets of each, base 128
    the packets, 1,206 bytes each, as one run of bytes, packed
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import replace
from typing import ClassVar

import numpy as np

from puckbench.codecs.base import Pace, Parameters, lengths
from puckbench.codecs.returns_codec import ReturnsCodec
from puckbench.coding.byte_io import Reader, base_128
from puckbench.coding.framing import Framing
from puckbench.core.errors import InputError
from puckbench.lidar.recordings.packet_turns import (
    SENSORS,
    PacketKind,
    packet_kind,
    packets_of,
    turn_of,
)
from puckbench.lidar.recordings.packets import DUAL_MODE, PACKET_BYTES, STRONGEST_MODE
from puckbench.lidar.returns import Returns
from puckbench.lidar.turns import Turn

_FEW_PACKETS = 1024
_MANY_PACKETS, _BYTES_PER_PACKET = 1 << 15, 64
"""Packets that any stream may hold, and the bytes of a further one: all have 400 returns or more,
and some seconds are spent on those of a stream of 1 MB."""


class PacketsCodec(ReturnsCodec):
    """Data packets of a VLP-16, Puck Hi-Res or HDL-32E, without loss; a subclass packs bytes.

    What returns do not have, times or reflectivities, is 0 in the packets. Virtual scans are
    refused: packets without reflectivities would be smaller than any sensor's.
    """

    metric_rates = lengths(2)
    packets_alone: ClassVar[bool] = True
    pace = Pace(0.1, 4.0)
    line = ":"

    @abstractmethod
    def _packed(self, data: bytes) -> bytes:
        """Bytes, packed."""

    @abstractmethod
    def _unpacked(self, stream: bytes, most: int) -> bytes:
        """The bytes of `_packed`; InputError when damaged, or where there are more than `most`."""

    @property
    def _framing(self) -> Framing:
        return Framing(self.magic, 1, self.title)

    def check_returns(self, returns: Returns) -> None:
        """Raise InputError unless returns are those of whole packets."""
        kind = _kind(returns)
        if any(len(turn.azimuths) % kind.layout.blocks_per_time for turn in returns.turns):
            raise InputError("a turn is not of whole data packets")

    def _encode_returns(self, returns: Returns, parameters: Parameters) -> bytes:
        kind = _kind(returns)
        parts = [packets_of(kind, _completed(turn, kind)) for turn in returns.turns]
        counts = [len(parts), *(len(part) for part in parts)]
        packed = self._packed(b"".join(part.tobytes() for part in parts))
        _check_packets(sum(counts[1:]), packed)
        return self._framing.framed(b"".join(map(base_128, counts)) + packed)

    def _decode_returns(self, stream: bytes) -> Returns:
        reader = Reader(self._framing.unframed(stream)[1])
        turns = reader.number()
        if turns > len(stream):
            raise InputError("the stream is damaged (its turns)")
        counts = [reader.number() for _ in range(turns)]
        packed = reader.rest()
        _check_packets(sum(counts), packed)
        data = self._unpacked(packed, sum(counts) * PACKET_BYTES)
        if len(data) != sum(counts) * PACKET_BYTES or not counts or not all(counts):
            raise InputError("the stream is damaged (its packets)")
        return _returns(np.frombuffer(data, np.uint8).reshape(-1, PACKET_BYTES), counts)


def _check_packets(count: int, packed: bytes) -> None:
    """Refuse more packets than any stream of the length holds: each has an azimuth of its own."""
    few = _FEW_PACKETS + len(packed) // 2
    if count > min(few, _MANY_PACKETS + len(packed) // _BYTES_PER_PACKET):
        raise InputError(f"{count} data packets in {len(packed)} bytes: more than they may hold")


def _kind(returns: Returns) -> PacketKind:
    """The kind of packets that hold returns; InputError where there is none."""
    mode = DUAL_MODE if returns.layout.kinds == 2 else STRONGEST_MODE
    for product in SENSORS:
        kind = packet_kind(product, mode)
        if replace(returns, turns=(), sensor="") == replace(kind.returns(()), sensor=""):
            return kind
    raise InputError("holds recordings of a VLP-16, Puck Hi-Res or HDL-32E, no other returns")


def _completed(turn: Turn, kind: PacketKind) -> Turn:
    """A turn with times and reflectivities, 0 where it has none."""
    times, reflectivities = turn.times, turn.reflectivities
    if times is None:
        times = np.zeros(len(turn.azimuths) // kind.layout.blocks_per_time, np.uint32)
    if reflectivities is None:
        reflectivities = np.zeros(turn.ranges.shape, np.uint8)
    return replace(turn, times=times, reflectivities=reflectivities)


def _returns(payloads: np.ndarray, counts: list[int]) -> Returns:
    """Returns of packets (p, 1206), given their numbers in each turn; InputError for others."""
    if (payloads[:, -2:] != payloads[0, -2:]).any():
        raise InputError("the stream is damaged (packets of several sensors)")
    kind = packet_kind(int(payloads[0, -1]), int(payloads[0, -2]))
    return kind.returns(turn_of(kind, part) for part in np.split(payloads, np.cumsum(counts)[:-1]))
