"""Encoding and decoding of points in millimetres with RENO.

The grid is that of the authors' program. Coordinates relative to a corner, at -131,072 mm on each
axis, are divided by the grid step (posQ in the program) and rounded, ties to even.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from pcc_networks.range_coder import Cumulative, Symbols, decode_symbols, encode_symbols
from pcc_networks.reno.inference import (
    Occupancy,
    predicted,
    prior_features,
    target_features,
)
from pcc_networks.reno.stream import (
    MAX_BASE,
    MAX_LEVEL,
    CodedTree,
    RenoStream,
    check_work,
    max_nodes,
    read_stream,
    write_stream,
)
from pcc_networks.reno.weights import VALUES, RenoWeights
from pcc_networks.sparse.thread_pool import thread_pool
from pcc_networks.sparse.voxels import (
    AXIS_BITS,
    Keys,
    children_voxels,
    keys_of_slots,
    morton_keys,
    morton_voxels,
    occupancies,
    parents_of,
    pyramid,
    slots_of_occupancies,
    unique_keys,
)
from pcc_networks.weights_file import OTHER_RESULT, check_digest
from pointkit.errors import NARROWER, InputError
from pointkit.geometry.cloud import Floats, check_points

Code = Callable[[int, Cumulative], Symbols]
"""Function that codes and returns the first or second symbols of a level."""


def encode_tree(keys: Keys, weights: RenoWeights) -> CodedTree:
    """Encode the octree of voxels.

    The result does not depend on the number of threads.

    Parameters
    ----------
    keys
        Morton keys (n,) of the voxels, sorted and distinct.
    weights
        The network.

    Raises
    ------
    InputError
        If there are too many voxels.
    """
    levels = list(_levels(keys))
    base, occupancy = levels[0]
    symbols: list[bytes] = []
    level_symbols = [half for _, codes in levels[1:] for half in (codes % VALUES, codes // VALUES)]

    def code(number: int, frequencies: Cumulative) -> Symbols:
        symbols.append(encode_symbols(level_symbols[number], frequencies))
        return level_symbols[number]

    nodes = [len(level) for level, _ in levels[1:]]
    if max(nodes, default=0) > MAX_LEVEL:
        raise InputError(f"the cloud has more than {MAX_LEVEL} voxels")
    _traverse(weights, base, occupancy, len(nodes), code, sum(nodes))
    tree = CodedTree(morton_voxels(base), occupancy, tuple(symbols), len(keys), _checksum(keys))
    check_work(tree, sum(nodes))
    return tree


def decode_tree(tree: CodedTree, weights: RenoWeights) -> Keys:
    """Decode an octree, and return the Morton keys (n,) of its voxels.

    Raises InputError if the keys differ from those that were encoded.
    """

    def code(number: int, frequencies: Cumulative) -> Symbols:
        return decode_symbols(tree.symbols[number], frequencies)

    base, levels = morton_keys(tree.base), len(tree.symbols) // 2
    try:
        keys = _traverse(weights, base, tree.occupancy, levels, code, max_nodes(tree))
    except InputError as error:
        raise InputError(OTHER_RESULT) from error
    if len(keys) != tree.count or _checksum(keys) != tree.check:
        raise InputError(OTHER_RESULT)
    return keys


def _traverse(
    weights: RenoWeights,
    keys: Keys,
    occupancy: Occupancy,
    levels: int,
    code: Code,
    max_nodes: int,
) -> Keys:
    with thread_pool() as pool:
        level = pyramid(keys, 0)[0][0]
        for number in range(levels):
            slots = slots_of_occupancies(occupancy)
            max_nodes -= len(slots)
            if max_nodes < 0 or len(slots) > MAX_LEVEL:
                raise InputError("the stream has too many voxels")
            prior = prior_features(weights, occupancy, level.neighbours, pool)
            level = children_voxels(level, keys_of_slots(level.keys, slots), pool)
            features = target_features(weights, prior, slots, level.neighbours, pool)
            first = code(2 * number, predicted(weights, 0, features, pool))
            second = code(2 * number + 1, predicted(weights, 1, features, pool, first))
            occupancy = first + VALUES * second
            if not occupancy.all():
                raise InputError("the stream has a voxel without children")
    return keys_of_slots(level.keys, slots_of_occupancies(occupancy))


def _levels(keys: Keys) -> Iterator[tuple[Keys, Occupancy]]:
    levels: list[tuple[Keys, Occupancy]] = []
    while not levels or len(levels[-1][0]) >= MAX_BASE:
        occupancy = occupancies(keys)
        keys = parents_of(keys)[0]
        levels.append((keys, occupancy))
    return reversed(levels)


def _checksum(keys: Keys) -> int:
    return zlib.crc32(np.ascontiguousarray(keys, "<i8").tobytes())


OFFSET = 131072
"""Distance from the corner of the authors' grid to the origin along each axis, in mm."""


def encode(points: Floats, weights: RenoWeights, posq: float) -> bytes:
    """Round points to a grid, and encode the voxels of the grid without loss.

    Parameters
    ----------
    points
        Points (n, 3), n >= 1, in mm. Points in the same voxel are merged.
    weights
        Weights that `load_weights` returned.
    posq
        Step of the grid in mm, which the authors call posQ. It must be a positive number that half
        precision represents exactly.

    Returns
    -------
    bytes
        The stream, which contains all that `decode` needs except the weights. It is a short header,
        followed by a stream of the authors' program.

    Raises
    ------
    InputError
        If points are not finite or need more than 20 bits per coordinate, or if `posq` is invalid.
    """
    check_points(points, "reno.encode")
    if float(np.float16(posq)) != posq or posq <= 0:
        raise InputError(f"posQ {posq:g} is not a number in half precision")
    offsets = _grid_offsets(points)
    voxels = np.rint((points + offsets * float(OFFSET)) / posq).astype(np.int64)
    if voxels.max() >= 2**AXIS_BITS:
        needed = f"more than {AXIS_BITS} bits per coordinate at posQ {posq:g}"
        raise InputError(f"the cloud needs {needed}{NARROWER}")
    tree = encode_tree(unique_keys(morton_keys(voxels)), weights)
    x, y, z = offsets.tolist()
    return write_stream(RenoStream(weights.digest, posq, (x, y, z), tree))


def decode(stream: bytes, weights: RenoWeights) -> Floats:
    """Decode a stream that `encode` of RENO returned.

    Parameters
    ----------
    stream
        All bytes that `encode` returned.
    weights
        The weights with which the stream was made.

    Returns
    -------
    ndarray
        Points (m, 3), float64, in mm: one for each occupied voxel of the grid, in Morton order.

    Raises
    ------
    InputError
        If the stream is damaged or was made with other weights, or if this machine computes other
        results than the machine of the encoder.
    """
    content = read_stream(stream)
    check_digest(weights.digest, content.digest)
    keys = decode_tree(content.tree, weights)
    corner = np.array(content.offsets) * float(OFFSET)
    points: Floats = morton_voxels(keys) * content.posq - corner
    return points


def _grid_offsets(points: Floats) -> NDArray[np.int64]:
    """Return each axis's distance from the grid's corner to the origin, in units of 131,072 mm."""
    least, most = points.min(axis=0), points.max(axis=0)
    is_near = (least >= -OFFSET) & (most < OFFSET)
    return np.where(is_near, 1, -np.floor(least / OFFSET)).astype(np.int64)
