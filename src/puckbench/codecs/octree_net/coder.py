"""Coding voxels level by level: the network predicts, the range coder codes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import chain
from typing import cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from puckbench.codecs.binary import read_to_its_end, written
from puckbench.codecs.gpcc.lossless import decode_voxels, encode_voxels
from puckbench.codecs.octree_net.coding import Frequencies, frequencies
from puckbench.codecs.octree_net.inference import convolved_rows
from puckbench.codecs.octree_net.mixing import Known, code_symbols, known_of, reader, writer
from puckbench.codecs.octree_net.model import Layer, OctreeNet, index
from puckbench.codecs.octree_net.stream import MOST_VOXELS, Part
from puckbench.codecs.octree_net.symbols import VALUES, Symbols, groups_of, slots_of, symbols_of
from puckbench.codecs.sparse.crew import Crew, Scratch, crew
from puckbench.codecs.sparse.voxels import (
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
from puckbench.errors import InputError

_MOST_TOP = 64
"""Voxels of the level where the network begins, at most; there the octree coder's bits are few."""
_ROWS = 4096

Rows = NDArray[np.int64]
Code = Callable[[Known, int, bool, Rows, Frequencies], Symbols]
"""Codes or reads the first or second symbols of a group's rows of a level; returns them."""


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
        with crew(self.threads) as workers, torch.no_grad():
            voxels = pyramid(top, 0)[0][0]
            level = Level(self.model, workers, voxels, self.model.start(len(top)))
            for depth in range(levels, 0, -1):
                level = level.next(code, most, last=depth == 1)
        return level.voxels.keys


@dataclass(frozen=True)
class Level:
    """Voxels of a level, and the features that those above have left them."""

    model: OctreeNet
    crew: Crew
    voxels: Voxels
    features: Tensor

    def next(self, code: Code, most: int, last: bool) -> Level:
        """The next finer level, of at most `most` voxels; of the `last` one only the keys count."""
        first, second = np.empty((2, len(self.voxels)), dtype=np.uint8)
        features, level = self._before(), known_of(self.voxels.neighbours)
        for group, rows in enumerate(groups_of(self.voxels.keys)):
            if len(rows):
                at = torch.from_numpy(rows)
                own = self._of_group(group, features, rows)
                said = self._said(self.model.first_heads[group], own)
                first[rows] = code(level, group, False, rows, said)
                own = self.model.with_first(own, index(first[rows], own))
                said = self._said(self.model.second_heads[group], own)
                second[rows] = code(level, group, True, rows, said)
                features[at] = self.model.with_second(own, index(second[rows], own))
        if ((first == 0) & (second == 0)).any():
            raise InputError("the stream is damaged (a voxel without children)")
        slots = slots_of(first, second)
        if len(slots) > most:
            raise InputError("the stream is damaged (its number of voxels)")
        keys = keys_of_slots(self.voxels.keys, slots)
        if last:
            return Level(self.model, self.crew, _keys_only(keys), features[:0])
        below = self.model.below(features, torch.from_numpy(slots))
        return Level(self.model, self.crew, children_voxels(self.voxels, keys, self.crew), below)

    def _before(self) -> Tensor:
        features, table = self.features, self.voxels.neighbours
        for layer in self.model.before:
            features = convolved_rows(cast(Layer, layer), features, table, None, self.crew)
        return features

    def _of_group(self, group: int, features: Tensor, rows: NDArray[np.int64]) -> Tensor:
        if group == 0:
            return features[torch.from_numpy(rows)]
        layer = cast(Layer, self.model.between[group - 1])
        return convolved_rows(layer, features, self.voxels.neighbours, rows, self.crew)

    def _said(self, head: nn.Module, features: Tensor) -> Frequencies:
        """What the network says of all symbols, computed some rows at a time."""
        said = np.empty((len(features), VALUES), dtype=np.float32)

        def work(rows: slice, _: Scratch) -> None:
            said[rows] = frequencies(head(features[rows]).numpy())

        self.crew.over(len(features), _ROWS, work)
        return said


def _runs(keys: Keys, below: Keys) -> Iterator[Symbols]:
    """The symbols of a level's voxels in the order in which they are coded."""
    first, second = symbols_of(below)
    for rows in groups_of(keys):
        if len(rows):
            yield first[rows]
            yield second[rows]


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
