"""Encoder and decoder of returns as data packets of a Velodyne.

A stream's body is:

    the number of turns, and the number of packets of each turn, base 128
    the packets, 1,206 bytes each, compressed
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from pointkit.coding.byte_io import Reader, base_128
from pointkit.errors import InputError
from pointkit.lidar.returns import Returns
from pointkit.lidar.turns import Turn
from puck.recordings.packet_turns import (
    SENSORS,
    PacketKind,
    kind_codes,
    packet_kind,
    packets_of,
    turn_of,
)
from puck.recordings.packets import DUAL_MODE, PACKET_BYTES, STRONGEST_MODE

_FEW_PACKETS = 1024
_MANY_PACKETS, _BYTES_PER_PACKET = 1 << 15, 64
"""Number of packets that any stream may hold, and bytes for each further packet; decoding 1 MB
takes some seconds at most."""


def encode_packets(returns: Returns, compress: Callable[[bytes], bytes]) -> bytes:
    """Encode returns as data packets of a Velodyne sensor.

    Missing times and reflectivities become 0.

    Parameters
    ----------
    returns
        Returns that fill whole data packets.
    compress
        Function that compresses the bytes of all packets.

    Returns
    -------
    bytes
        The body of a stream, as the module describes it.

    Raises
    ------
    InputError
        The returns do not fill whole packets of a Velodyne sensor that puckbench knows.
    """
    kind = check_whole_packets(returns)
    parts = [packets_of(kind, _completed(turn, kind)) for turn in returns.turns]
    counts = [len(part) for part in parts]
    packed = compress(b"".join(part.tobytes() for part in parts))
    _check_packets(sum(counts), packed)
    return b"".join(map(base_128, [len(parts), *counts])) + packed


def decode_packets(body: bytes, decompress: Callable[[bytes, int], bytes]) -> Returns:
    """Decode the returns in a stream's body.

    Parameters
    ----------
    body
        Result of `encode_packets`.
    decompress
        Function that decompresses the packets. Its arguments are the bytes and the largest allowed
        number of decompressed bytes.

    Raises
    ------
    InputError
        The body is damaged.
    """
    reader = Reader(body)
    turns = reader.number()
    if turns > len(body):
        raise InputError("the stream is damaged (its turns)")
    counts = [reader.number() for _ in range(turns)]
    packed = reader.rest()
    _check_packets(sum(counts), packed)
    data = decompress(packed, sum(counts) * PACKET_BYTES)
    if len(data) != sum(counts) * PACKET_BYTES or not counts or not all(counts):
        raise InputError("the stream is damaged (its packets)")
    return _returns(np.frombuffer(data, np.uint8).reshape(-1, PACKET_BYTES), counts)


def check_whole_packets(returns: Returns) -> PacketKind:
    """Return the kind of data packets that the returns fill; raise InputError if no kind fits."""
    kind = _kind(returns)
    if any(len(turn.azimuths) % kind.layout.blocks_per_time for turn in returns.turns):
        raise InputError("a turn is not of whole data packets")
    return kind


def _check_packets(count: int, packed: bytes) -> None:
    few = _FEW_PACKETS + len(packed) // 2
    if count > min(few, _MANY_PACKETS + len(packed) // _BYTES_PER_PACKET):
        raise InputError(
            f"{count} data packets in {len(packed)} bytes: more than a stream can hold"
        )


def _kind(returns: Returns) -> PacketKind:
    mode = DUAL_MODE if returns.layout.kinds == 2 else STRONGEST_MODE
    for product in SENSORS:
        kind = packet_kind(product, mode)
        if replace(returns, turns=(), sensor="") == replace(kind.returns(()), sensor=""):
            return kind
    raise InputError("encodes only returns of Velodynes with the shipped descriptions")


def _completed(turn: Turn, kind: PacketKind) -> Turn:
    times, reflectivities = turn.times, turn.reflectivities
    if times is None:
        times = np.zeros(len(turn.azimuths) // kind.layout.blocks_per_time, np.uint32)
    if reflectivities is None:
        reflectivities = np.zeros(turn.ranges.shape, np.uint8)
    return replace(turn, times=times, reflectivities=reflectivities)


def _returns(payloads: np.ndarray, counts: list[int]) -> Returns:
    codes = kind_codes(payloads)
    if (codes != codes[0]).any():
        raise InputError("the stream is damaged (packets of several sensors)")
    kind = packet_kind(*codes[0].tolist())
    return kind.returns(turn_of(kind, part) for part in np.split(payloads, np.cumsum(counts)[:-1]))
