"""The stream of PoLoPCAC.

* digest of the weights (8 bytes), number of points (base-128), CRC-32 of all values (uint32),
  number of attributes (1 byte)
* each attribute: its kind (1 byte, plus 128 if values are stored), then
  stored values: length (base-128), a Zstandard frame of the values in the order of positions;
  or the values of the first group, and for each of the other groups the length (base-128) of its
  range-coded values, and these
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from pcc_networks.polopcac.attributes import KINDS, Kind
from pcc_networks.polopcac.grouping import first_group, groups
from pcc_networks.weights_file import DIGEST_BYTES
from pointkit.coding.byte_io import Reader, base_128
from pointkit.errors import InputError

_CHECK = struct.Struct("<I")
_STORED = 128
_POINTS, _POINTS_PER_BYTE = 2**14, 8
"""Most points that the network codes, and additional points per byte of an attribute."""


@dataclass(frozen=True)
class CodedAttribute:
    """An encoded attribute: stored values, or a first group and range-coded groups."""

    kind: Kind
    stored: bytes | None
    first: bytes = b""
    groups: tuple[bytes, ...] = ()

    def packed(self) -> bytes:
        """Return the bytes of the attribute in a stream."""
        number = KINDS.index(self.kind)
        if self.stored is not None:
            return bytes([number | _STORED]) + base_128(len(self.stored)) + self.stored
        runs = (base_128(len(run)) + run for run in self.groups)
        return bytes([number]) + self.first + b"".join(runs)


@dataclass(frozen=True)
class PolopcacStream:
    """The content of a stream: numbers of its header, and attributes that are still encoded."""

    digest: bytes  # of the weights
    points: int
    check: int  # CRC-32 of all values
    attributes: tuple[CodedAttribute, ...]


def write_stream(content: PolopcacStream) -> bytes:
    """Return the bytes of a stream."""
    head = content.digest + base_128(content.points) + _CHECK.pack(content.check)
    parts = [attribute.packed() for attribute in content.attributes]
    return b"".join([head, bytes([len(parts)]), *parts])


def read_stream(stream: bytes) -> PolopcacStream:
    """Divide a stream into its header and its attributes, without decoding them.

    Raises InputError if the stream is damaged.
    """
    reader = Reader(stream)
    digest, points = reader.take(DIGEST_BYTES), reader.number()
    (check,) = _CHECK.unpack(reader.take(_CHECK.size))
    attributes = tuple(_attribute(reader, points) for _ in range(reader.take(1)[0]))
    names = {attribute.kind.name for attribute in attributes}
    if reader.at != len(stream) or not points or not 0 < len(names) == len(attributes):
        raise InputError("the stream is damaged (its attributes)")
    return PolopcacStream(digest, points, check, attributes)


def attribute_bytes(stream: bytes) -> dict[str, int]:
    """Return how many bytes of a stream each attribute takes, by name.

    The header counts as a part of the first attribute. Raises InputError if the stream is damaged.
    """
    attributes = read_stream(stream).attributes
    sizes = {attribute.kind.name: len(attribute.packed()) for attribute in attributes}
    sizes[attributes[0].kind.name] += len(stream) - sum(sizes.values())
    return sizes


def is_decodable(attribute: CodedAttribute, points: int) -> bool:
    """Return whether a decoder accepts an attribute: the network takes time for each point."""
    most = _POINTS + _POINTS_PER_BYTE * sum(map(len, attribute.groups))
    return attribute.stored is not None or points <= most


def _attribute(reader: Reader, points: int) -> CodedAttribute:
    number = reader.take(1)[0]
    if number & ~_STORED >= len(KINDS):
        raise InputError("the stream is damaged (an attribute)")
    kind = KINDS[number & ~_STORED]
    if number & _STORED:
        return CodedAttribute(kind, reader.take(reader.number()))
    if not kind.levels or points > _POINTS + _POINTS_PER_BYTE * len(reader.body):
        raise InputError("the stream is damaged (too many points for its size)")
    first = reader.take(first_group(points) * kind.channels)
    runs = tuple(reader.take(reader.number()) for _ in groups(points))
    attribute = CodedAttribute(kind, None, first, runs)
    if not is_decodable(attribute, points):
        raise InputError("the stream is damaged (too many points for its size)")
    return attribute
