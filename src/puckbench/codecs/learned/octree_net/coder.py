"""Coding voxels level by level: the network predicts, the range coder codes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from puckbench.codecs.common.binary_coder import read_to_its_end, written
from puckbench.codecs.gpcc.lossless import decode_voxels, encode_voxels
from puckbench.codecs.learned.octree_net.causal_neighbourhood import Known, known_of, look_around
from puckbench.codecs.learned.octree_net.frequencies import Frequencies
from puckbench.codecs.learned.octree_net.inference import (
    Features,
    Group,
    Network,
    before_groups,
    below,
    chunks_of,
    group_of,
    network_of,
    start,
)
from puckbench.codecs.learned.octree_net.layers import Rows
from puckbench.codecs.learned.octree_net.mixing import code_symbols, reader, writer
from puckbench.codecs.learned.octree_net.model import OctreeNet
from puckbench.codecs.learned.octree_net.stream import MOST_VOXELS, Part
from puckbench.codecs.learned.octree_net.symbols import Symbols, groups_of, slots_of, symbols_of
from puckbench.codecs.learned.sparse.thread_pool import Crew, crew
from puckbench.codecs.learned.sparse.voxels import (
    AXIS_BITS,
    Keys,
    Voxels,
    children_voxels,
    distinct,
    keys_of_slots,
    morton_keys,
    morton_voxels,
    parents_of,
    pyramid,
)
from puckbench.core.errors import InputError

_MOST_TOP = 64
"""Voxels of the level where the network begins, at most; there the octree coder's bits are few."""

Code = Callable[[Known, int, bool, Rows, Frequencies], Symbols]
"""Codes or reads the first or second symbols of some rows of a level's group; returns them."""


@dataclass(frozen=True)
class Coder:
    """Codes voxels with a network, on one thread or more with the same result."""

    model: OctreeNet
    threads: int | None = None

    def encode(self, keys: Keys) -> Part:
        """Code voxels, keys ascending and distinct."""
        sets = [keys]
        while len(sets[-1]) > _MOST_TOP:
            sets.append(parents_of(sets[-1])[0])
        mixer = writer(sum(map(len, sets[1:])))
        waiting = chain.from_iterable(map(_runs, sets[:0:-1], sets[-2::-1]))

        def code(level: Known, group: int, second: bool, rows: Rows, said: Frequencies) -> Symbols:
            symbols = next(waiting)
            code_symbols(mixer, level, group, second, rows, symbols, said)
            return symbols

        self._descend(sets[-1], len(sets) - 1, code, len(keys))
        top = encode_voxels(morton_voxels(sets[-1]))
        return Part(len(keys), len(sets) - 1, top, written(mixer.bits))

    def decode(self, part: Part) -> Keys:
        """The keys of a part; InputError when it is damaged."""
        mixer = reader(part.symbols)

        def code(level: Known, group: int, second: bool, rows: Rows, said: Frequencies) -> Symbols:
            symbols = np.zeros(len(rows), dtype=np.uint8)
            code_symbols(mixer, level, group, second, rows, symbols, said)
            return symbols

        keys = self._descend(_top_keys(part), part.levels, code, part.count)
        if len(keys) != part.count or not read_to_its_end(mixer.bits):
            raise InputError("the stream is damaged (its number of voxels)")
        return keys

    def _descend(self, top: Keys, levels: int, code: Code, most: int) -> Keys:
        """From the top level to the finest; InputError where one has more than `most` voxels."""
        network = network_of(self.model)
        with crew(self.threads) as workers:
            level = Level(network, workers, pyramid(top, 0)[0][0], start(network, len(top)))
            for depth in range(levels, 0, -1):
                level = level.next(code, most, last=depth == 1)
        return level.voxels.keys


@dataclass(frozen=True)
class Level:
    """Voxels of a level, and the features that those above have left them."""

    network: Network
    crew: Crew
    voxels: Voxels
    features: Features

    def next(self, code: Code, most: int, last: bool) -> Level:
        """The next finer level, of at most `most` voxels; of the `last` one only the keys count."""
        features, slots = self._coded(code)
        if len(slots) > most:
            raise InputError("the stream is damaged (its number of voxels)")
        keys = keys_of_slots(self.voxels.keys, slots)
        if last:
            return Level(self.network, self.crew, _keys_only(keys), features)
        handed = below(self.network, features, slots, self.crew)
        voxels = children_voxels(self.voxels, keys, self.crew)
        return Level(self.network, self.crew, voxels, handed)

    def _coded(self, code: Code) -> tuple[Features, Rows]:
        """Code all symbols: features that know them, and the slots of the children."""
        table = self.voxels.neighbours
        features = before_groups(self.network, self.features, table, self.crew)
        symbols, known = np.empty((2, len(self.voxels)), dtype=np.uint8), known_of(table)
        for number, rows in enumerate(groups_of(self.voxels.keys)):
            group = group_of(self.network, number, rows)
            self._code(group, features, known, symbols, code)
        if (symbols == 0).all(axis=0).any():
            raise InputError("the stream is damaged (a voxel without children)")
        return features, slots_of(*symbols)

    def _code(
        self, group: Group, features: Features, known: Known, symbols: Symbols, code: Code
    ) -> None:
        """Code a group's symbols; while those of a chunk are coded the crew works on others."""

        def say(chunk: slice) -> Frequencies:
            look_around(known, group.rows[chunk])
            return group.say_first(features, known.neighbours, chunk)

        chunks, begin = chunks_of(len(group.rows)), self.crew.begin
        at = [group.rows[chunk] for chunk in chunks]
        said = [begin(partial(say, chunk)) for chunk in chunks]
        for i, chunk in enumerate(chunks):
            first = symbols[0, at[i]] = code(known, group.number, False, at[i], said[i]())
            said[i] = begin(partial(group.say_second, chunk, first))
        finished = []
        for i, chunk in enumerate(chunks):
            second = symbols[1, at[i]] = code(known, group.number, True, at[i], said[i]())
            finished.append(begin(partial(group.finish, chunk, second, features)))
        for wait in finished:
            wait()


def _runs(keys: Keys, below: Keys) -> Iterator[Symbols]:
    """The symbols of a level's voxels in the order in which they are coded."""
    first, second = symbols_of(below)
    for rows in groups_of(keys):
        for symbols in (first, second):
            yield from (symbols[rows[chunk]] for chunk in chunks_of(len(rows)))


def _keys_only(keys: Keys) -> Voxels:
    return Voxels(keys, np.empty((0, 0), dtype=np.int32))


def _top_keys(part: Part) -> Keys:
    voxels: NDArray[np.int64] = decode_voxels(part.top)
    least, most = 0, 2 ** (AXIS_BITS - part.levels)
    if not 0 < len(voxels) <= _MOST_TOP or voxels.min() < least or voxels.max() >= most:
        raise InputError("the stream is damaged (its top level)")
    return distinct(morton_keys(voxels))


def split(keys: Keys, most: int = MOST_VOXELS) -> list[Keys]:
    """Cut keys into parts of at most `most`, one after the other."""
    return [keys[first : first + most] for first in range(0, len(keys), most)]
