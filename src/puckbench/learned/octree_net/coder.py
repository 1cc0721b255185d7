from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import chain
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from puckbench.coding.binary_coder import exhausted, read_to_its_end, written
from puckbench.core.errors import InputError
from puckbench.gpcc.lossless import decode_voxels, encode_voxels
from puckbench.learned.device import device_of
from puckbench.learned.octree_net.causal_neighbourhood import (
    LevelState,
    empty_state,
    find_neighbourhood,
)
from puckbench.learned.octree_net.device_inference import DevicePredictor
from puckbench.learned.octree_net.inference import (
    LevelPredictor,
    VoxelGroup,
    chunks_of,
    compiled_network,
)
from puckbench.learned.octree_net.layers import Rows
from puckbench.learned.octree_net.mixing import code_symbols, reader, writer
from puckbench.learned.octree_net.model import OctreeNet
from puckbench.learned.octree_net.stream import MAX_VOXELS, CodedPart, max_nodes
from puckbench.learned.octree_net.symbols import (
    Frequencies,
    Symbols,
    groups_of,
    slots_of,
    symbols_of,
)
from puckbench.learned.sparse.thread_pool import ThreadPool, thread_pool
from puckbench.learned.sparse.voxels import (
    AXIS_BITS,
    Keys,
    VoxelSet,
    children_voxels,
    keys_of_slots,
    morton_keys,
    morton_voxels,
    parents_of,
    pyramid,
    unique_keys,
)

F = TypeVar("F")
_MAX_TOP = 64
"""Maximum voxels of the top level, where the network begins; coarser levels take few bits."""

Code = Callable[[LevelState, int, bool, Rows, Frequencies], Symbols]
"""Codes the first or second symbols of some rows of a level's group, and returns them."""


class DecodingLimits(NamedTuple):
    voxels: int  # of a level
    nodes: int  # of all levels except the finest
    has_more: Callable[[], bool]  # whether the stream has not ended yet


@dataclass(frozen=True)
class OctreeNetCoder:
    """Codes voxels by their Morton keys; results do not depend on the number of threads."""

    model: OctreeNet
    threads: int | None = None

    def encode(self, keys: Keys) -> CodedPart:
        sets = [keys]
        while len(sets[-1]) > _MAX_TOP:
            sets.append(parents_of(sets[-1])[0])
        nodes = sum(map(len, sets[1:]))
        mixer = writer(nodes)
        symbol_chunks = chain.from_iterable(map(_symbol_chunks, sets[:0:-1], sets[-2::-1]))

        def code(
            level: LevelState, group: int, second: bool, rows: Rows, predicted: Frequencies
        ) -> Symbols:
            symbols = next(symbol_chunks)
            code_symbols(mixer, level, group, second, rows, symbols, predicted)
            return symbols

        limits = DecodingLimits(len(keys), nodes, lambda: True)
        self._traverse(sets[-1], len(sets) - 1, code, limits)
        top = encode_voxels(morton_voxels(sets[-1]))
        part = CodedPart(len(keys), len(sets) - 1, top, written(mixer.bits))
        if nodes > max_nodes(part):
            raise InputError(f"the cloud's octree has {nodes} nodes, too many for its bytes")
        return part

    def decode(self, part: CodedPart) -> Keys:
        mixer = reader(part.symbols)

        def code(
            level: LevelState, group: int, second: bool, rows: Rows, predicted: Frequencies
        ) -> Symbols:
            symbols = np.zeros(len(rows), dtype=np.uint8)
            code_symbols(mixer, level, group, second, rows, symbols, predicted)
            return symbols

        limits = DecodingLimits(part.count, max_nodes(part), lambda: not exhausted(mixer.bits))
        keys = self._traverse(_top_keys(part), part.levels, code, limits)
        if len(keys) != part.count or not read_to_its_end(mixer.bits):
            raise InputError("the stream is damaged (its number of voxels)")
        return keys

    def _traverse(self, top: Keys, levels: int, code: Code, limits: DecodingLimits) -> Keys:
        nodes = 0
        network = network_of(self.model)
        with thread_pool(self.threads) as pool:
            voxels = pyramid(top, 0)[0][0]
            level = OctreeLevel(network, pool, voxels, network.root_features(len(top)))
            for depth in range(levels, 0, -1):
                nodes += len(level.voxels)
                if nodes > limits.nodes or not limits.has_more():
                    raise InputError("the stream is damaged (its octree)")
                level = level.next(code, limits.voxels, last=depth == 1)
        return level.voxels.keys


def network_of(model: OctreeNet) -> LevelPredictor[Any]:
    if device_of(model).type == "cpu":
        return compiled_network(model)
    return DevicePredictor(model)


@dataclass(frozen=True)
class OctreeLevel(Generic[F]):
    network: LevelPredictor[F]
    pool: ThreadPool
    voxels: VoxelSet
    features: F

    def next(self, code: Code, max_voxels: int, last: bool) -> OctreeLevel[F]:
        """Encode or decode the next finer level; if it is the `last`, compute only its keys."""
        features, slots = self._code_children(code)
        if len(slots) > max_voxels:
            raise InputError("the stream is damaged (its number of voxels)")
        keys = keys_of_slots(self.voxels.keys, slots)
        if last:
            return OctreeLevel(self.network, self.pool, _without_neighbours(keys), features)
        child_features = self.network.child_features(features, slots, self.pool)
        voxels = children_voxels(self.voxels, keys, self.pool)
        return OctreeLevel(self.network, self.pool, voxels, child_features)

    def _code_children(self, code: Code) -> tuple[F, Rows]:
        table = self.voxels.neighbours
        features = self.network.convolved(self.features, table, self.pool)
        symbols, state = np.empty((2, len(self.voxels)), dtype=np.uint8), empty_state(table)
        for number, rows in enumerate(groups_of(self.voxels.keys)):
            group = self.network.group(number, rows, features, table)
            self._code_group(group, state, symbols, code)
        if (symbols == 0).all(axis=0).any():
            raise InputError("the stream is damaged (a voxel without children)")
        return features, slots_of(*symbols)

    def _code_group(
        self, group: VoxelGroup, state: LevelState, symbols: Symbols, code: Code
    ) -> None:
        """Encode or decode a group's symbols while other threads predict the next chunk."""

        def predict_first(chunk: slice) -> Frequencies:
            find_neighbourhood(state, group.rows[chunk])
            return group.predict_first(chunk)

        chunks, submit = chunks_of(len(group.rows)), self.pool.submit
        rows = [group.rows[chunk] for chunk in chunks]
        predictions = [submit(partial(predict_first, chunk)) for chunk in chunks]
        for i, chunk in enumerate(chunks):
            first = symbols[0, rows[i]] = code(
                state, group.number, False, rows[i], predictions[i]()
            )
            predictions[i] = submit(partial(group.predict_second, chunk, first))
        updates = []
        for i, chunk in enumerate(chunks):
            second = symbols[1, rows[i]] = code(
                state, group.number, True, rows[i], predictions[i]()
            )
            updates.append(submit(partial(group.update, chunk, second)))
        for wait in updates:
            wait()


def _symbol_chunks(keys: Keys, children: Keys) -> Iterator[Symbols]:
    first, second = symbols_of(children)
    for rows in groups_of(keys):
        for symbols in (first, second):
            yield from (symbols[rows[chunk]] for chunk in chunks_of(len(rows)))


def _without_neighbours(keys: Keys) -> VoxelSet:
    return VoxelSet(keys, np.empty((0, 0), dtype=np.int32))


def _top_keys(part: CodedPart) -> Keys:
    voxels: NDArray[np.int64] = decode_voxels(part.top, _MAX_TOP)
    lower, upper = 0, 2 ** (AXIS_BITS - part.levels)
    if not 0 < len(voxels) <= _MAX_TOP or voxels.min() < lower or voxels.max() >= upper:
        raise InputError("the stream is damaged (its top level)")
    return unique_keys(morton_keys(voxels))


def split(keys: Keys, max_voxels: int = MAX_VOXELS) -> list[Keys]:
    return [keys[first : first + max_voxels] for first in range(0, len(keys), max_voxels)]
