"""Encoding and decoding of points in metres with LiZIP, as the authors' program in C++ does it.

Points are sorted by cubes of 0.1 m, in Morton order, and rounded to a grid. The network predicts
each from the first of the five points before it. Coordinates are numbers of single precision
throughout, whose spacing is 0.008 mm from 64 to 128 m.
"""

from __future__ import annotations

import zlib

import numpy as np
from numpy.typing import NDArray

from pcc_networks.lizip.compression import NUMBERS, Compression
from pcc_networks.lizip.inference import predicted, steps_of
from pcc_networks.lizip.stream import (
    BLOCK,
    LEAST_SCALE,
    MAX_POINTS,
    MOST_SCALE,
    LizipStream,
    Words,
    packed_numbers,
    read_stream,
    write_stream,
)
from pcc_networks.lizip.weights import HEAD, Floats32, LizipWeights
from pcc_networks.sparse.thread_pool import ThreadPool, thread_pool
from pcc_networks.weights_file import OTHER_RESULT, check_digest
from pointkit.errors import NARROWER, InputError
from pointkit.geometry.cloud import Floats, check_points

_CUBE = np.float32(0.1)
_AXIS_BITS = 21
_MOST_STEPS = 2.0**31


def encode(
    points: Floats, weights: LizipWeights, step_m: float, compression: Compression = "lzma"
) -> bytes:
    """Round points to a grid, and encode them without further loss, sorted by cubes.

    Parameters
    ----------
    points
        Points (n, 3), n >= 1, in m; they are rounded to single precision.
    weights
        Weights that `load_weights` returned.
    step_m
        Step of the grid, m. The authors' is 0.00001.
    compression
        ``lzma`` for few bits, ``zlib`` to be quick.

    Returns
    -------
    bytes
        The stream, which contains all that `decode` needs except the weights. It is a short header,
        followed by the file of the authors' program.

    Raises
    ------
    InputError
        If the step is not from 1e-7 to 1000 m, or points are not finite or need more than 32 bits
        per coordinate, or are so many and so regular that a decoder would refuse the stream.
    """
    check_points(points, "lizip.encode")
    if len(points) > MAX_POINTS:
        raise InputError(f"the cloud has {len(points)} points, more than {MAX_POINTS}")
    scale = np.float32(1 / step_m)
    if not LEAST_SCALE <= scale <= MOST_SCALE:
        raise InputError(f"lizip.encode: step_m is {step_m:g}, not from 1e-07 to 1000 m")
    if np.abs(points).max() * float(scale) >= _MOST_STEPS - 1:
        raise InputError(f"the cloud needs more than 32 bits per coordinate{NARROWER}")
    single = points.astype(np.float32)
    steps = steps_of(single[_order(single)], scale)
    content = _coded(steps, weights, scale, compression)
    return write_stream(content)


def decode(stream: bytes, weights: LizipWeights) -> Floats:
    """Decode a stream that `encode` of LiZIP returned.

    Parameters
    ----------
    stream
        All bytes that `encode` returned.
    weights
        The weights with which the stream was made.

    Returns
    -------
    ndarray
        Points (n, 3), float64, in m, in the order of the stream: the numbers of single precision
        that the authors' program writes.

    Raises
    ------
    InputError
        If the stream is damaged or was made with other weights, or if this machine computes other
        results than the machine of the encoder.
    """
    content = read_stream(stream)
    check_digest(weights.digest, content.digest)
    steps = _decoded(content, weights)
    if _checksum(steps) != content.check:
        raise InputError(OTHER_RESULT)
    return _metres(steps, np.float32(content.scale)).astype(np.float64)


def _order(points: Floats32) -> NDArray[np.int64]:
    """Return the order (n,) of points by the Morton codes of their cubes, x lowest."""
    cubes = ((points - points.min(axis=0)) / _CUBE).astype(np.uint64)
    codes = np.zeros(len(points), np.uint64)
    for bit in range(_AXIS_BITS):
        for axis in range(3):
            place = np.uint64(3 * bit + axis)
            codes |= ((cubes[:, axis] >> np.uint64(bit)) & np.uint64(1)) << place
    return np.argsort(codes, kind="stable")


def _metres(steps: Words, scale: np.float32) -> Floats32:
    metres: Floats32 = steps.astype(np.float32) / scale
    return metres


def _coded(
    steps: Words, weights: LizipWeights, scale: np.float32, compression: Compression
) -> LizipStream:
    count = len(steps)
    numbers = np.arange(count)
    targets = numbers[numbers % BLOCK >= HEAD]
    metres = _metres(steps, scale)
    read = targets[:, None] - HEAD + np.arange(weights.context)
    contexts = metres[read].reshape(len(targets), 3 * weights.context)
    with thread_pool() as pool:
        guesses = predicted(weights, contexts, scale, pool)
    blocks = np.zeros((-(-count // BLOCK) * BLOCK, 3), np.int32)
    blocks[:count] = steps
    blocks[targets] -= guesses
    by_block = blocks.reshape(-1, BLOCK, 3)
    packed = packed_numbers(by_block[:, :HEAD], by_block[:, HEAD:], compression)
    check, number = _checksum(steps), NUMBERS[compression]
    return LizipStream(weights.digest, check, count, float(scale), number, packed)


def _decoded(content: LizipStream, weights: LizipWeights) -> Words:
    heads, differences = content.numbers()
    steps = np.concatenate([heads, differences], axis=1)
    with thread_pool() as pool:
        _add_predictions(steps, weights, np.float32(content.scale), pool)
    return steps.reshape(-1, 3)[: content.points]


def _add_predictions(
    steps: Words, weights: LizipWeights, scale: np.float32, pool: ThreadPool
) -> None:
    """Add to all but the first points of each block, one after the other, what is predicted."""
    metres = _metres(steps, scale)
    for place in range(HEAD, BLOCK):
        context = metres[:, place - HEAD : place - HEAD + weights.context]
        steps[:, place] += predicted(weights, context.reshape(len(steps), -1), scale, pool)
        metres[:, place] = _metres(steps[:, place], scale)


def _checksum(steps: Words) -> int:
    return zlib.crc32(np.ascontiguousarray(steps, "<i4").tobytes())
