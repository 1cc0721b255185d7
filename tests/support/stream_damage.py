"""Damaged streams: flipped, cut, spliced, with absurd sizes; the same for the same number."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Sequence

import numpy as np

from pointkit.seeding import generator

Random = np.random.Generator
_UNIT = struct.Struct(">BI")


def limit(random: Random, bits: int) -> int:
    """A number of at most `bits` bits: 0, 1, the largest, a power of two or its neighbour."""
    power = 1 << int(random.integers(bits))
    result = (0, 1, (1 << bits) - 1, power - 1, power, power + 1)[random.integers(6)]
    return min(result, (1 << bits) - 1)


def units(stream: bytes) -> list[bytes]:
    """The type-length-value units that a bare stream consists of."""
    result, at = [], 0
    while at + _UNIT.size <= len(stream):
        end = at + _UNIT.size + _UNIT.unpack_from(stream, at)[1]
        result.append(stream[at:end])
        at = end
    return result


def damaged(streams: Sequence[bytes], number: int, codec: str = "gpcc") -> bytes:
    """One damaged stream, made of whole `streams` of a codec (G-PCC: bare ones).

    Every other one of a codec with a check sum has one that fits, as an attacker would send it.
    """
    random = generator(number, "damaged G-PCC streams")
    stream = streams[random.integers(len(streams))]
    mutation = MUTATIONS[random.integers(len(MUTATIONS))]
    changed = mutation(stream, streams, random)
    if random.random() < 0.2:
        changed = MUTATIONS[random.integers(len(MUTATIONS))](changed, streams, random)
    seal = SEALS.get(codec)
    return seal(changed) if seal is not None and number % 2 else changed


def _sealed_at(at: int) -> Callable[[bytes], bytes]:
    """A CRC-32 at byte `at` of all that follows it."""
    return lambda stream: (
        stream[:at] + struct.pack("<I", zlib.crc32(stream[at + 4 :])) + stream[at + 4 :]
    )


def _sealed_at_the_end(stream: bytes) -> bytes:
    return stream[:-2] + struct.pack("<H", zlib.crc32(stream[:-2]) & 0xFFFF)


def _sealed_records(stream: bytes) -> bytes:
    """Records of the codec of returns: a kind, a length of seven bits a byte, a CRC-32, a body."""
    parts, at = [stream[:5]], 5
    while at < len(stream):
        head = at + 1
        while head < len(stream) and stream[head] >= 128 and head < at + 5:
            head += 1
        head += 1
        length = sum((byte & 127) << 7 * k for k, byte in enumerate(stream[at + 1 : head]))
        start = head + 4 * (length > 0)
        body = stream[start : start + length]
        check = zlib.crc32(body, stream[at]).to_bytes(4, "little") if length else b""
        parts.append(stream[at:head] + check + body)
        at = start + length
    return b"".join(parts)


FRAMED = ("packets_xz", "packets_zstd", "jpegls", "jpegxl")
"""Codecs whose streams are those of `pointkit.coding.framing`, without a header."""
SEALS: dict[str, Callable[[bytes], bytes]] = {
    "pcgcv1_plus": _sealed_at(5),
    "pcgcv2_plus": _sealed_at(6),
    "sparse_octree_net": _sealed_at(5),
    "reno": _sealed_at(5),
    "lizip": _sealed_at(5),
    "inter_lpcm": _sealed_at(5),
    "polopcac": _sealed_at(5),
    "primitives": _sealed_at_the_end,
    "puck": _sealed_records,
    "puck_smoothed": lambda stream: stream[:6] + _sealed_records(stream[6:]),
    **dict.fromkeys(FRAMED, _sealed_at(5)),
}
"""What makes the check sums of streams fit again, where a codec has them."""


def _flipped(stream: bytes, _: Sequence[bytes], random: Random) -> bytes:
    bits = np.unpackbits(np.frombuffer(stream, np.uint8))
    for _ in range(random.integers(1, 9) if len(bits) else 0):
        bits[random.integers(len(bits))] ^= 1
    return np.packbits(bits).tobytes()


def _flipped_header(stream: bytes, streams: Sequence[bytes], random: Random) -> bytes:
    head = 60
    return _flipped(stream[:head], streams, random) + stream[head:]


def _flipped_end(stream: bytes, streams: Sequence[bytes], random: Random) -> bytes:
    tail = max(0, len(stream) - 10)
    return stream[:tail] + _flipped(stream[tail:], streams, random)


def _cut(stream: bytes, _: Sequence[bytes], random: Random) -> bytes:
    return stream[: random.integers(len(stream) + 1)]


def _cut_within_its_length(stream: bytes, streams: Sequence[bytes], random: Random) -> bytes:
    """The last unit is shorter, and says so."""
    parts = units(stream)
    if not parts or len(parts[-1]) <= _UNIT.size:
        return stream
    body = _cut(parts[-1][_UNIT.size :], streams, random)
    return b"".join(parts[:-1]) + _UNIT.pack(parts[-1][0], len(body)) + body


def _overwritten(stream: bytes, _: Sequence[bytes], random: Random) -> bytes:
    """Four bytes, aligned with nothing, hold an absurd number."""
    absurd = (0xFFFFFFFF, 0x7FFFFFFF, 0x80000000, 0, 0x00FFFFFF, 0x01000000)
    at = random.integers(min(len(stream), 80) + 1)
    number = absurd[random.integers(len(absurd))].to_bytes(4, "big")
    return stream[:at] + number + stream[at + 4 :]


def _overwritten_end(stream: bytes, _: Sequence[bytes], random: Random) -> bytes:
    """The footer, which holds the number of points, holds an absurd one."""
    length = int(random.integers(1, 6))
    ending = random.integers(0, 256, length, dtype=np.uint8).tobytes()
    return stream[: max(0, len(stream) - length)] + (b"\xff" * length, ending)[random.integers(2)]


def _spliced(stream: bytes, streams: Sequence[bytes], random: Random) -> bytes:
    """The beginning of one stream and the end of another."""
    other = streams[random.integers(len(streams))]
    return stream[: random.integers(len(stream) + 1)] + other[random.integers(len(other) + 1) :]


def _mixed(stream: bytes, streams: Sequence[bytes], random: Random) -> bytes:
    """Whole units of two streams: one's parameter sets before the other's data, or any order."""
    mine, others = units(stream), units(streams[random.integers(len(streams))])
    if random.random() < 0.7:
        return b"".join([*mine[:-1], *others[-1:]])
    parts = [*mine, *others]
    chosen = random.integers(0, len(parts), random.integers(1, len(parts) + 2))
    return b"".join(parts[i] for i in chosen)


def _inserted(stream: bytes, _: Sequence[bytes], random: Random) -> bytes:
    at = random.integers(len(stream) + 1)
    noise = random.integers(0, 256, random.integers(1, 200), dtype=np.uint8).tobytes()
    return stream[:at] + noise + stream[at:]


MUTATIONS: tuple[Callable[[bytes, Sequence[bytes], Random], bytes], ...] = (
    _flipped,
    _flipped_header,
    _flipped_header,
    _flipped_end,
    _cut,
    _cut_within_its_length,
    _overwritten,
    _overwritten,
    _overwritten_end,
    _spliced,
    _mixed,
    _inserted,
)
