"""Encoding and decoding of attributes with PoLoPCAC.

The order of the points is that of their positions and attributes, shuffled. A point is predicted
from the eight nearest among those of groups before its own (see `grouping`).
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcc_networks.polopcac.attributes import Kind, Table, coded, kind_of, uncoded
from pcc_networks.polopcac.distributions import decode_values, encode_values, laplace
from pcc_networks.polopcac.fixed_point import STEP, Floats
from pcc_networks.polopcac.grouping import first_group, groups, shuffled
from pcc_networks.polopcac.inference import NEIGHBOURS, predicted
from pcc_networks.polopcac.neighbours import nearest
from pcc_networks.polopcac.stream import (
    CodedAttribute,
    PolopcacStream,
    is_decodable,
    read_stream,
    write_stream,
)
from pcc_networks.polopcac.weights import CHANNELS, PolopcacWeights
from pcc_networks.sparse.thread_pool import thread_pool
from pcc_networks.weights_file import check_digest
from pointkit.coding.zstandard import compressed, decompressed
from pointkit.errors import InputError

_MOST_EXTENT = 2**24
"""Greatest extent of positions, whose squared distances are then exact in double precision."""
_DAMAGED = (
    "the stream decodes to other attributes than were coded: it is damaged, or the positions are "
    "others"
)


class Channels(NamedTuple):
    """An attribute of all points in coding order, as far as it is known."""

    kind: Kind
    table: Table  # (n, channels), as they are coded


class Distributions(NamedTuple):
    """Predicted Laplace distributions of an attribute's values of a group of points."""

    attribute: int  # number of the attribute
    rows: slice  # the points
    locations: Floats  # (m * channels,)
    scales: Floats  # (m * channels,)


def encode(
    positions: NDArray[np.int64], attributes: Mapping[str, NDArray[Any]], weights: PolopcacWeights
) -> bytes:
    """Encode attributes of points without loss.

    The bytes depend neither on the order of the points nor on the number of threads.

    Parameters
    ----------
    positions
        Whole numbers (n, 3), n >= 1, which the decoder knows. Points may be equal.
    attributes
        Whole numbers by name, at least one of ``reflectance`` (n,), from 0 to 65,535, and
        ``colour`` (n, 3) with red, green and blue. Row i belongs to row i of `positions`. The
        network codes reflectances of up to 255; if there are larger ones, all are stored with
        Zstandard.
    weights
        Weights that `load_weights` returned.

    Returns
    -------
    bytes
        The stream, which contains all that `decode` needs except the positions and the weights.

    Raises
    ------
    InputError
        There are no points or no attributes, the positions extend beyond 2^24 steps, or an
        attribute is not of this kind.
    """
    points = _checked(positions)
    if not attributes:
        raise InputError("polopcac.encode: there are no attributes")
    held = {name: np.asarray(values) for name, values in attributes.items()}
    kinds = [kind_of(name, values, len(points)) for name, values in held.items()]
    tables = [
        values.astype(np.int32).reshape(len(points), kind.channels)
        for kind, values in zip(kinds, held.values(), strict=True)
    ]
    order = _sorted_rows(points, *tables)
    mixed = order[shuffled(len(points))]
    channels = [
        Channels(kind, coded(kind, table[mixed])) for kind, table in zip(kinds, tables, strict=True)
    ]
    runs: list[list[bytes]] = [[] for _ in kinds]

    def code(part: Distributions) -> None:
        kind, table = channels[part.attribute]
        values = table[part.rows].ravel()
        runs[part.attribute].append(encode_values(values, part.locations, part.scales, kind.levels))

    predict(points[mixed], channels, weights, code)
    parts, first = [], mixed[: first_group(len(points))]
    for kind, table, coded_groups in zip(kinds, tables, runs, strict=True):
        start = table[first].astype(kind.dtype).tobytes()
        part = CodedAttribute(kind, None, start, tuple(coded_groups))
        if not kind.levels or not is_decodable(part, len(points)):
            part = CodedAttribute(kind, compressed(table[order].astype(kind.dtype).tobytes()))
        parts.append(part)
    check = _checksum([table[mixed] for table in tables])
    return write_stream(PolopcacStream(weights.digest, len(points), check, tuple(parts)))


def decode(
    stream: bytes, positions: NDArray[np.int64], weights: PolopcacWeights
) -> dict[str, NDArray[Any]]:
    """Decode the attributes of points.

    Parameters
    ----------
    stream
        All bytes that `encode` returned.
    positions
        The positions (n, 3) that were encoded, in any order.
    weights
        The weights with which the stream was made.

    Returns
    -------
    dict
        Attributes by name, as ``uint8`` or ``uint16``. Row i belongs to row i of `positions`;
        among equal positions, the order is arbitrary.

    Raises
    ------
    InputError
        The stream is damaged, was made with other weights or belongs to other positions.
    """
    content = read_stream(stream)
    check_digest(weights.digest, content.digest)
    points = _checked(positions)
    if len(points) != content.points:
        raise InputError(f"the stream is of {content.points} points, not of {len(points)}")
    order, mixing = _sorted_rows(points), shuffled(len(points))
    mixed, first = order[mixing], first_group(len(points))
    channels = []
    for part in content.attributes:
        table = np.zeros((len(points), part.kind.channels), np.int32)
        if part.stored is None:
            table[:first] = _values(part.first, part.kind, first)
        else:
            size = len(points) * part.kind.channels * np.dtype(part.kind.dtype).itemsize
            table[:] = _values(decompressed(part.stored, size), part.kind, len(points))[mixing]
        channels.append(Channels(part.kind, coded(part.kind, table)))
    runs = [iter(part.groups) for part in content.attributes]

    def code(part: Distributions) -> None:
        kind, table = channels[part.attribute]
        data = next(runs[part.attribute])
        values = decode_values(data, part.locations, part.scales, kind.levels)
        table[part.rows] = values.reshape(-1, kind.channels)

    by_network = [
        each if part.stored is None else each._replace(kind=each.kind._replace(levels=0))
        for each, part in zip(channels, content.attributes, strict=True)
    ]
    predict(points[mixed], by_network, weights, code)
    tables = [uncoded(kind, table) for kind, table in channels]
    if _checksum(tables) != content.check:
        raise InputError(_DAMAGED)
    result = {}
    for (kind, _), table in zip(channels, tables, strict=True):
        values = np.empty(table.shape, np.dtype(kind.dtype).newbyteorder("="))
        values[mixed] = table
        result[kind.name] = values if kind.channels > 1 else values[:, 0]
    return result


def predict(
    positions: Floats,
    attributes: Sequence[Channels],
    weights: PolopcacWeights,
    code: Callable[[Distributions], None],
) -> None:
    """Predict the attributes of points, group by group.

    Parameters
    ----------
    positions
        Whole numbers (n, 3), in coding order.
    attributes
        The attributes; those without levels are left out.
    weights
        The network.
    code
        Function that codes a group of points, and writes the values of these rows to the table of
        the attribute if they are not there yet.
    """
    numbers = [number for number, each in enumerate(attributes) if each.kind.levels]
    if not numbers:
        return
    with thread_pool() as pool:
        for rows in groups(len(positions)):
            near = nearest(positions[rows], positions[: rows.start], NEIGHBOURS, pool)
            offsets = _in_unit_ball(positions[near] - positions[rows, None])
            for number in numbers:
                kind, table = attributes[number]
                values = np.rint(table[near] / STEP / np.array(kind.divisors))
                held = np.repeat(values, CHANNELS // kind.channels, axis=-1)
                outputs = predicted(weights, offsets, held, pool)
                code(Distributions(number, rows, *laplace(outputs, kind.channels, kind.peak)))


def _in_unit_ball(offsets: Floats) -> Floats:
    """Divide offsets (m, 8, 3) of neighbours by the largest length, and round them to steps."""
    longest = np.sqrt((offsets * offsets).sum(axis=-1).max(axis=-1))
    longest[longest == 0] = 1
    steps: Floats = np.rint(offsets / STEP / longest[:, None, None])
    return steps


def _checked(positions: NDArray[np.int64]) -> Floats:
    whole = np.asarray(positions)
    if whole.ndim != 2 or whole.shape[1] != 3 or not len(whole) or whole.dtype.kind not in "iu":
        raise InputError("polopcac: positions are whole numbers of shape (n, 3), n at least 1")
    least, most = whole.min(axis=0), whole.max(axis=0)
    if max(int(b) - int(a) for a, b in zip(least, most, strict=True)) > _MOST_EXTENT:
        raise InputError("polopcac: positions extend beyond 2^24 steps")
    moved: Floats = (whole.astype(np.int64) - least).astype(np.float64)
    return moved


def _sorted_rows(positions: Floats, *tables: Table) -> NDArray[np.int64]:
    """Return the order of points by x, then y, z, and the attributes."""
    columns = [*positions.T, *(column for table in tables for column in table.T)]
    return np.lexsort(columns[::-1])


def _values(data: bytes, kind: Kind, points: int) -> Table:
    values = np.frombuffer(data, kind.dtype)
    if len(values) != points * kind.channels:
        raise InputError("the stream is damaged (its values)")
    return values.reshape(points, kind.channels).astype(np.int32)


def _checksum(tables: Sequence[Table]) -> int:
    check = 0
    for table in tables:
        check = zlib.crc32(np.ascontiguousarray(table, "<i4").tobytes(), check)
    return check
