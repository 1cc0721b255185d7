"""Encoding and decoding of streams of returns, with or without a description of the beams."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from io import BytesIO

from pointkit.errors import InputError
from pointkit.lidar.returns import Returns
from pointkit.lidar.turns import Layout, Turn
from puck import turns
from puck.options import CodingOptions
from puck.records import (
    Record,
    RecordKind,
    check,
    check_ranges,
    count_ranges,
    join_records,
    read_records,
)
from puck.returns_header import decode_beams, decode_layout, encode_beams, encode_layout
from puck.turn_streams import Writer
from puck.turns import TurnDecoder, TurnEncoder, turn_step


def encode_returns(returns: Returns, options: CodingOptions | None = None) -> bytes:
    """Encode the returns of a sensor as one stream, which `decode_returns` decodes.

    Parameters
    ----------
    returns
        Revolutions, and the beams of the sensor.
    options
        Options of encoding. By default, nothing is lost; a larger step quantises ranges, and times
        and reflectivities can be left out.

    Returns
    -------
    bytes
        The stream, which contains all that `decode_returns` needs.

    Raises
    ------
    InputError
        The returns have more ranges than a decoder accepts for a stream of this size.
    """
    encoder = TurnEncoder(returns.layout, options)
    bodies = [encoder.encode(turn) for turn in returns.turns]
    stream = join_records(
        [
            Record(RecordKind.LAYOUT, encode_layout(returns.layout)),
            Record(RecordKind.BEAMS, encode_beams(returns)),
            *(Record(RecordKind.TURN, turn) for turn in bodies),
        ]
    )
    check_ranges(sum(count_ranges(returns.layout, body) for body in bodies), len(stream))
    return stream


def decode_returns(stream: bytes) -> Returns:
    """Decode a stream that `encode_returns` wrote.

    Parameters
    ----------
    stream
        The bytes of the whole stream.

    Returns
    -------
    Returns
        Revolutions, and the beams of the sensor. Ranges are multiples of the quantisation step, in
        the sensor's quanta. Times and reflectivities are None if the encoder left them out.

    Raises
    ------
    InputError
        The stream is damaged, of another version, or of another kind, such as a compressed
        recording.
    """
    without_turns, bodies = _read(stream)
    decoder = TurnDecoder(without_turns.layout)
    return replace(without_turns, turns=tuple(decoder.decode(body) for body in bodies))


def range_steps(stream: bytes) -> list[float]:
    """Return the quantisation step of each turn's ranges, in metres.

    The step is the sensor's quantum if nothing was lost. The turns are not decoded.

    Parameters
    ----------
    stream
        A stream that `encode_returns` wrote.

    Returns
    -------
    list of float
        One step for each turn.
    """
    without_turns, bodies = _read(stream)
    return [turn_step(body) * without_turns.quantum_m for body in bodies]


def reflectivity_bytes(stream: bytes) -> int:
    """Return how many bytes of a stream that `encode_returns` wrote hold reflectivities."""
    without_turns, bodies = _read(stream)
    return sum(turns.reflectivity_bytes(body, without_turns.layout) for body in bodies)


def encode_turns(
    turns: Iterable[Turn], layout: Layout, options: CodingOptions | None = None
) -> bytes:
    """Encode revolutions that share one layout as one stream, without a description of beams.

    Parameters
    ----------
    turns
        Revolutions in chronological order. Each may have its own number of columns.
    layout
        Arrangement of the lasers in the images of all turns.
    options
        Options of encoding. By default, nothing is lost.

    Returns
    -------
    bytes
        The stream, which `puck.decode_turns` decodes.

    Raises
    ------
    InputError
        The arrays of a turn do not have the layout's shapes and types.

    Examples
    --------
    >>> import numpy as np
    >>> from puck import decode_turns, encode_turns
    >>> from pointkit.lidar.turns import Layout, Turn
    >>> ranges = np.full((1, 4, 2), 500, np.uint16)  # one return per beam, 4 columns, 2 lasers
    >>> turn = Turn(ranges, azimuths=np.arange(0, 80, 20, dtype=np.uint16))
    >>> stream = encode_turns([turn, turn], Layout(order=(1, 0)))
    >>> [bool((decoded.ranges == ranges).all()) for decoded in decode_turns(stream)]
    [True, True]
    """
    stream = BytesIO()
    with Writer(stream, layout, options) as writer:
        for turn in turns:
            writer.add(turn)
    return stream.getvalue()


def _read(stream: bytes) -> tuple[Returns, list[bytes]]:
    records = read_records(BytesIO(stream))
    layout = decode_layout(_body(records, RecordKind.LAYOUT))[0]
    without_turns = decode_beams(_body(records, RecordKind.BEAMS), layout)
    *turns, _ = records
    check(all(record.kind == RecordKind.TURN for record in turns))
    bodies = [record.body for record in turns]
    check_ranges(sum(count_ranges(layout, body) for body in bodies), len(stream))
    return without_turns, bodies


def _body(records: Iterator[Record], kind: RecordKind) -> bytes:
    record = next(records)
    if record.kind != kind:
        raise InputError("not a stream of returns; decompress a compressed recording first")
    return record.body
