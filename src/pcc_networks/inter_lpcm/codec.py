"""Encoding and decoding of a turn with Inter-LPCM."""

from __future__ import annotations

import itertools
import zlib
from contextlib import AbstractContextManager
from dataclasses import dataclass

import numpy as np

from pcc_networks.inter_lpcm.mixing import (
    MAX_VALUE,
    ElevationCoder,
    decode_corrections,
    encode_corrections,
)
from pcc_networks.inter_lpcm.prediction import (
    RADIUS,
    Reference,
    points_at_steps,
    rounded,
    traverse,
)
from pcc_networks.inter_lpcm.stream import (
    MAX_RADIUS,
    Heads,
    LpcmStream,
    Part,
    read_stream,
    write_stream,
)
from pcc_networks.inter_lpcm.symbols import (
    SymbolNetwork,
    SymbolReader,
    SymbolWriter,
    contexts_of,
    symbol_reader,
)
from pcc_networks.inter_lpcm.turn import STEPS_PER_TURN, Ints, Lines, cartesian, lines_of
from pcc_networks.inter_lpcm.weights import HISTORY, LpcmWeights
from pcc_networks.weights_file import OTHER_RESULT, check_digest
from pointkit.errors import NARROWER, InputError
from pointkit.geometry.cloud import Floats, check_points

USUAL_AZIMUTH_STEPS = 4
"""Azimuth symbol that stands for those before the first of a line, 0.18 degrees."""
_TOLERANCE = 1e-4
"""Mean difference of decoded coordinates, m, up to which machines count as equal."""


@dataclass(frozen=True)
class CodedTurn:
    """A turn that was encoded or decoded.

    Parameters
    ----------
    stream
        All bytes.
    lines
        The decoded points before their correction.
    azimuth, radius, elevation
        Symbols (n,), line after line; the first azimuth symbol of each line is 0, since it is in
        the header.
    corrections
        (n, 3), in steps along x, y and z.
    points
        The decoded points (n, 3), m, in the order in which they were encoded.
    """

    stream: bytes
    lines: Lines
    azimuth: Ints
    radius: Ints
    elevation: Ints
    corrections: Ints
    points: Floats


def encode(
    points: Floats, weights: LpcmWeights, step: float, reference: Reference | None = None
) -> bytes:
    """Encode the points of a turn.

    Parameters
    ----------
    points
        Points (n, 3), n >= 1, in metres from the sensor, in the order in which they were measured:
        laser after laser.
    weights
        Weights that `load_weights` returned.
    step
        Step of the corrections of decoded points, m: a coordinate's error is half a step at most.
    reference
        The preceding turn (`reference_of`), or None. The decoder needs the same one.

    Raises
    ------
    InputError
        Points are not finite, or too far away.
    """
    return encode_turn(points, weights, step, reference).stream


def encode_turn(
    points: Floats, weights: LpcmWeights, step: float, reference: Reference | None = None
) -> CodedTurn:
    """Encode the points of a turn as `encode` does, and return all that was coded."""
    check_points(points, "inter_lpcm.encode")
    points = np.asarray(points, np.float64)
    if not 0 < step <= MAX_RADIUS:
        raise InputError(f"a step of {step:g} m")
    if np.abs(points).max() > MAX_RADIUS / 2:
        raise InputError(f"the cloud is too wide for inter_lpcm{NARROWER}")
    lines = lines_of(points)
    first = lines.starts[:-1]
    heads = Heads(
        lines.lengths,
        lines.azimuth[first],
        lines.radius[first].astype(np.float32),
        lines.elevation[first].astype(np.float32),
    )
    azimuth = np.diff(lines.azimuth, prepend=0)
    azimuth[first] = 0
    radius, elevation = np.zeros((2, len(points)), np.int64)
    elevations = ElevationCoder.writer(len(lines.lengths), len(points))

    def code(kind: int, at: Ints, rows: Ints, predicted: Floats) -> Ints:
        values = lines.radius if kind == RADIUS else lines.elevation
        symbols = rounded(kind, values[at], predicted)
        if kind == RADIUS:
            radius[at] = symbols
        else:
            elevation[at] = elevations.code(symbols, rows, radius[at])
        return symbols

    decoded = traverse(heads, lines.azimuth, weights, reference, code)
    corrections, corrected = _corrected(points, decoded, step)
    content = LpcmStream(
        weights.digest,
        _check_of(reference),
        _check(azimuth, radius, elevation, corrections),
        step,
        float(corrected.sum()),
        heads,
        _encoded(SymbolNetwork(weights.azimuth_symbols), azimuth, lines.starts, 1),
        _encoded(SymbolNetwork(weights.radius_symbols), radius, lines.starts, 0),
        elevations.written(),
        encode_corrections(corrections, lines.azimuth),
    )
    return CodedTurn(
        write_stream(content), decoded, azimuth, radius, elevation, corrections, corrected
    )


def decode(stream: bytes, weights: LpcmWeights, reference: Reference | None = None) -> CodedTurn:
    """Decode a stream that `encode` returned.

    Parameters
    ----------
    stream
        All bytes that `encode` returned.
    weights
        The weights with which the stream was made.
    reference
        The preceding turn with which it was made, or None.

    Raises
    ------
    InputError
        The stream is damaged, or was made with other weights or another preceding turn.
    """
    content = read_stream(stream)
    check_digest(weights.digest, content.digest)
    if content.reference != _check_of(reference):
        raise InputError("the stream was made with another preceding turn")
    heads = content.heads
    starts = heads.starts
    azimuth = _decoded_azimuth(content.azimuth, SymbolNetwork(weights.azimuth_symbols), starts)
    steps = _summed(azimuth, heads, starts)
    radius, elevation = np.zeros((2, len(azimuth)), np.int64)
    network = SymbolNetwork(weights.radius_symbols)
    before = np.zeros((len(heads.lengths), HISTORY), np.int64)
    elevations = ElevationCoder.reader(len(heads.lengths), content.elevation)
    with _symbols_in(content.radius, "radii") as reader:

        def code(kind: int, at: Ints, rows: Ints, _predicted: Floats) -> Ints:
            if kind == RADIUS:
                symbols = _read_next(reader, network, before, rows)
                radius[at] = symbols
            else:
                symbols = elevations.code(np.zeros_like(at), rows, radius[at])
                elevation[at] = symbols
            return symbols

        lines = traverse(heads, steps, weights, reference, code)
    elevations.check_end()
    corrections = decode_corrections(content.corrections, steps)
    if _check(azimuth, radius, elevation, corrections) != content.check:
        raise InputError(OTHER_RESULT)
    points = cartesian(lines) + corrections * content.step
    if not abs(points.sum() - content.total) <= _TOLERANCE * points.size:
        raise InputError(OTHER_RESULT)
    return CodedTurn(stream, lines, azimuth, radius, elevation, corrections, points)


def _corrected(points: Floats, lines: Lines, step: float) -> tuple[Ints, Floats]:
    decoded = cartesian(lines)
    corrections = np.rint((points - decoded) / step)
    if np.abs(corrections).max() > MAX_VALUE:
        raise InputError(f"the cloud is too wide for steps of {step:g} m{NARROWER}")
    return corrections.astype(np.int64), decoded + corrections * step


def _encoded(network: SymbolNetwork, symbols: Ints, starts: Ints, first: int) -> Part:
    """Encode symbols (n,) step by step, from step number `first` on."""
    before = USUAL_AZIMUTH_STEPS if first else 0
    contexts = np.empty((len(symbols), HISTORY), np.int16)
    for start, end in itertools.pairwise(starts):
        contexts[start + first : end] = contexts_of(symbols[start + first : end], before)
    order = [at for step, (at, _) in enumerate(points_at_steps(starts)) if step >= first]
    places = np.concatenate(order) if order else np.zeros(0, np.int64)
    coded = symbols[places]
    least, most = int(coded.min(initial=0)), int(coded.max(initial=0))
    writer = SymbolWriter(least, most)
    if len(coded):
        writer.write(coded, network.distributions(contexts[places]))
    return Part(least, most, writer.written())


def _symbols_in(part: Part, name: str) -> AbstractContextManager[SymbolReader]:
    return symbol_reader(part.data, part.least, part.most, name)


def _read_next(reader: SymbolReader, network: SymbolNetwork, before: Ints, rows: Ints) -> Ints:
    """Decode the next symbol of each of the lines `rows`, given those before, (lines, 49)."""
    symbols = reader.read(network.distributions(before[rows]))
    before[rows, :-1] = before[rows, 1:]
    before[rows, -1] = symbols
    return symbols


def _decoded_azimuth(part: Part, network: SymbolNetwork, starts: Ints) -> Ints:
    symbols = np.zeros(starts[-1], np.int64)
    before = np.full((len(starts) - 1, HISTORY), USUAL_AZIMUTH_STEPS, np.int64)
    with _symbols_in(part, "azimuths") as reader:
        for step, (at, rows) in enumerate(points_at_steps(starts)):
            if step:
                symbols[at] = _read_next(reader, network, before, rows)
    return symbols


def _summed(azimuth: Ints, heads: Heads, starts: Ints) -> Ints:
    """Return the azimuths (n,) of all points, as numbers of azimuth steps.

    `azimuth` (n,) has the difference of each point to the point before in its line.

    A line begins at the azimuth in its head. Raises InputError if an azimuth is not within a turn.
    """
    differences = azimuth.copy()
    differences[starts[:-1]] = heads.azimuth
    sums = np.cumsum(differences)
    sums -= np.repeat(sums[starts[:-1]] - heads.azimuth, heads.lengths)
    if sums.min() < 0 or sums.max() > STEPS_PER_TURN:
        raise InputError(OTHER_RESULT)
    return sums


def _check(*parts: Ints) -> int:
    return zlib.crc32(b"".join(part.astype("<i4").tobytes() for part in parts))


def _check_of(reference: Reference | None) -> int:
    """Return a number that tells turns apart, from the numbers of points of their lines."""
    if reference is None:
        return 0
    lengths = np.array([len(line) for line in reference.lines], "<i8")
    return zlib.crc32(lengths.tobytes()) or 1
