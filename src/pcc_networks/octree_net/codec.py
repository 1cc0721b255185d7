"""Encoding and decoding with the sparse octree net, from the coarsest level to the finest."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpcc.grid import DEFAULT_GRID, InputGrid, input_coordinates, quantise
from gpcc.lossless import decode_voxels, encode_voxels
from pcc_networks.octree_net.causal_neighbourhood import LevelState, empty_state, find_neighbourhood
from pcc_networks.octree_net.inference import CHUNK_ROWS, CompiledGroup, Rows, compiled_network
from pcc_networks.octree_net.mixing import code_symbols, reader, writer
from pcc_networks.octree_net.model import OctreeNet
from pcc_networks.octree_net.stream import (
    MAX_VOXELS,
    CodedPart,
    OctreeNetStream,
    max_nodes,
    read_stream,
    write_stream,
)
from pcc_networks.octree_net.symbols import Frequencies, Symbols, groups_of, slots_of, symbols_of
from pcc_networks.octree_net.weights import OctreeNetWeights
from pcc_networks.sparse.thread_pool import ThreadPool, slices, thread_pool
from pcc_networks.sparse.voxels import (
    AXIS_BITS,
    Keys,
    children_voxels,
    keys_of_slots,
    morton_keys,
    morton_voxels,
    parents_of,
    pyramid,
    unique_keys,
)
from pcc_networks.weights_file import check_digest
from pointkit.coding.binary_coder import exhausted, read_to_its_end, written
from pointkit.coding.context_mixing import Mixer
from pointkit.errors import NARROWER, InputError
from pointkit.geometry.cloud import Floats, check_points

_MAX_TOP = 64
"""Maximum voxels of the top level, where the network begins; coarser levels take few bits."""


def encode_part(keys: Keys, model: OctreeNet) -> CodedPart:
    """Encode one part of a cloud.

    The result does not depend on the number of threads.

    Parameters
    ----------
    keys
        Morton keys (n,) of the voxels, sorted and distinct.
    model
        The network.

    Raises
    ------
    InputError
        If the octree has more nodes than a decoder accepts for so few bytes.
    """
    levels = [keys]
    while len(levels[-1]) > _MAX_TOP:
        levels.append(parents_of(levels[-1])[0])
    *finer, top = levels
    nodes = sum(map(len, levels[1:]))
    mixer = writer(nodes)
    _traverse(model, mixer, top, len(finer), len(keys), nodes, finer)
    coded_top = encode_voxels(morton_voxels(top))
    part = CodedPart(len(keys), len(finer), coded_top, written(mixer.bits))
    if nodes > max_nodes(part):
        raise InputError(f"the cloud's octree has {nodes} nodes, too many for its bytes")
    return part


def decode_part(part: CodedPart, model: OctreeNet) -> Keys:
    """Decode one part of a cloud, and return the Morton keys (n,) of its voxels.

    Raises InputError if the part is damaged.
    """
    mixer = reader(part.symbols)
    keys = _traverse(model, mixer, _top_keys(part), part.levels, part.count, max_nodes(part))
    if len(keys) != part.count or not read_to_its_end(mixer.bits):
        raise InputError("the stream is damaged (its number of voxels)")
    return keys


def _traverse(
    model: OctreeNet, mixer: Mixer, keys: Keys, levels: int, max_voxels: int, nodes_left: int,
    finer: Sequence[Keys] = (),
) -> Keys:  # fmt: skip
    """Encode or decode the levels below the top level, and return the keys of the finest level.

    An encoder passes the keys of these levels in `finer`, the finest first.
    """
    network = compiled_network(model)
    with thread_pool() as pool:
        voxels, features = pyramid(keys, 0)[0][0], network.root_features(len(keys))
        for depth in range(levels - 1, -1, -1):
            nodes_left -= len(voxels)
            if nodes_left < 0 or exhausted(mixer.bits):
                raise InputError("the stream is damaged (its octree)")
            symbols = np.zeros((2, len(voxels)), dtype=np.uint8)
            if finer:
                symbols[:] = symbols_of(finer[depth])
            features = network.convolved(features, voxels.neighbours, pool)
            state = empty_state(voxels.neighbours)
            for number, rows in enumerate(groups_of(voxels.keys)):
                group = network.group(number, rows, features, voxels.neighbours)
                _code_group(mixer, state, group, number, rows, symbols, pool)
            slots = slots_of(*symbols)
            if len(slots) > max_voxels or not symbols.any(axis=0).all():
                raise InputError("the stream is damaged (its number of voxels)")
            keys = keys_of_slots(voxels.keys, slots)
            if depth:
                features = network.child_features(features, slots, pool)
                voxels = children_voxels(voxels, keys, pool)
    return keys


def _code_group(
    mixer: Mixer, state: LevelState, group: CompiledGroup, number: int, rows: Rows,
    symbols: Symbols, pool: ThreadPool,
) -> None:  # fmt: skip
    """Encode the symbols (2, n) of a level at the rows of a group, or decode them in place.

    Meanwhile, other threads predict the symbols of the next chunks of rows.
    """

    def predict_first(chunk: slice) -> Frequencies:
        find_neighbourhood(state, rows[chunk])
        return group.predict_first(chunk)

    def code(half: int, chunk: slice, frequencies: Frequencies) -> Symbols:
        coded: Symbols = symbols[half, rows[chunk]]
        code_symbols(mixer, state, number, half == 1, rows[chunk], coded, frequencies)
        symbols[half, rows[chunk]] = coded
        return coded

    chunks = slices(len(rows), CHUNK_ROWS)
    results: list[Callable[[], Any]] = [pool.submit(partial(predict_first, c)) for c in chunks]
    for half, following in enumerate((group.predict_second, group.update)):
        for i, chunk in enumerate(chunks):
            coded = code(half, chunk, results[i]())
            results[i] = pool.submit(partial(following, chunk, coded))
    for wait in results:
        wait()


def _top_keys(part: CodedPart) -> Keys:
    voxels: NDArray[np.int64] = decode_voxels(part.top, _MAX_TOP)
    lower, upper = 0, 2 ** (AXIS_BITS - part.levels)
    if not 0 < len(voxels) <= _MAX_TOP or voxels.min() < lower or voxels.max() >= upper:
        raise InputError("the stream is damaged (its top level)")
    return unique_keys(morton_keys(voxels))


def split(keys: Keys, max_voxels: int = MAX_VOXELS) -> list[Keys]:
    """Split keys (n,) into parts of at most `max_voxels`."""
    return [keys[first : first + max_voxels] for first in range(0, len(keys), max_voxels)]


def encode(
    points: Floats,
    weights: OctreeNetWeights,
    scale: float = 1.0,
    grid: InputGrid = DEFAULT_GRID,
) -> bytes:
    """Round points to a grid, and encode the voxels of the grid without loss.

    Parameters
    ----------
    points
        Points (n, 3), n >= 1. Points in the same voxel are merged.
    weights
        Weights that `load_weights` returned.
    scale
        Number of steps of the coded grid per step of the input's grid. The step of the coded grid
        is ``grid.unit / scale``.
    grid
        Step and origin of the input's grid, by default 1 and (0, 0, 0).

    Returns
    -------
    bytes
        The stream, which contains all that `decode` needs except the weights.

    Raises
    ------
    InputError
        If points are not finite, or span 2**20 steps or more of the coded grid.
    """
    check_points(points, "octree_net.encode")
    positions, origin = quantise(points, grid, scale, "nearest")
    if positions.max() >= 2**AXIS_BITS:
        raise InputError(f"the cloud spans more than {AXIS_BITS} bits at scale {scale:g}{NARROWER}")
    keys = unique_keys(morton_keys(positions))
    parts = tuple(encode_part(part, weights.model) for part in split(keys))
    x, y, z = origin.tolist()
    return write_stream(OctreeNetStream(weights.digest, scale, (x, y, z), grid, parts))


def decode(stream: bytes, weights: OctreeNetWeights) -> Floats:
    """Decode a stream that `encode` of the sparse octree net returned.

    Parameters
    ----------
    stream
        All bytes that `encode` returned.
    weights
        The weights with which the stream was made.

    Returns
    -------
    ndarray
        Points (m, 3), float64, in the units of the encoded points: one for each occupied voxel of
        the coded grid, in Morton order.

    Raises
    ------
    InputError
        If the stream is damaged, or was made with other weights.
    """
    content = read_stream(stream)
    check_digest(weights.digest, content.digest)
    keys = np.concatenate([decode_part(part, weights.model) for part in content.parts])
    units = (morton_voxels(keys) + np.array(content.origin)) / content.scale
    return input_coordinates(units, content.grid)
