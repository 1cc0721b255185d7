"""Coding voxels with a set of weights: network, latent, coordinates, block by block."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from puckbench.codecs.gpcc.lossless import decode_voxels, encode_voxels
from puckbench.codecs.learned.adaptive_entropy import (
    decode_in_context,
    encode_in_context,
    everywhere,
)
from puckbench.codecs.learned.entropy_bottleneck import Table
from puckbench.codecs.learned.grid_level import side_of
from puckbench.codecs.learned.pcgcv2.inference import analyse, synthesise
from puckbench.codecs.learned.pcgcv2.model import SCALES
from puckbench.codecs.learned.pcgcv2.stream import MOST_VOXELS, OURS, Block, Coded, Rules
from puckbench.codecs.learned.pcgcv2.weights import WeightSet
from puckbench.codecs.learned.point_reconstruction import Octets, filled, points_per_voxel, together
from puckbench.codecs.learned.range_coding import decode_latent, encode_latent
from puckbench.codecs.learned.sparse.thread_pool import Crew, crew
from puckbench.codecs.learned.sparse.voxels import (
    AXIS_BITS,
    Keys,
    Voxels,
    distinct,
    morton_keys,
    morton_voxels,
    pyramid,
)
from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats

Integers = NDArray[np.int32]
Triples = NDArray[np.int64]
STRIDE = 2**SCALES


@dataclass(frozen=True)
class Coder:
    """Codes voxels at one rate of a set of weights.

    rho: share of the occupied voxels that the decoder keeps at the last scale. most_voxels: of a
    block. threads: as many as PyTorch would use by default. rules: what the stream says of itself.
    fill: decode as many points as were coded, not one for each voxel.
    """

    weights: WeightSet
    rate: int
    rho: float = 1.0
    most_voxels: int = MOST_VOXELS
    threads: int | None = None
    rules: Rules = OURS
    fill: bool = True

    def encode(self, voxels: Triples, quarters: int = 0) -> Coded:
        """Code voxels (n, 3), in any order, duplicates too; InputError when they span too much.

        quarters: of a halving of the grid that they are on, for the decoder to know. With `fill`
        it is told how many of them share a voxel, too.
        """
        origin = voxels.min(axis=0) // STRIDE * STRIDE
        if (voxels.max(axis=0) - origin).max() >= 2**AXIS_BITS:
            raise InputError(f"the cloud spans more than {2**AXIS_BITS} voxels")
        keys = distinct(morton_keys(voxels - origin))
        with crew(self.threads) as workers, torch.no_grad():
            blocks = tuple(
                self._encode_block(part, workers) for part in split(keys, self.most_voxels)
            )
        x, y, z = origin.tolist()
        digest = self.weights.digest
        per_voxel = points_per_voxel(len(voxels), len(keys), self.rho) if self.fill else 0
        return Coded(digest, self.rate, (x, y, z), blocks, quarters, self.rules, per_voxel)

    def decode(self, coded: Coded) -> Floats:
        """The points (n, 3) of a stream made with these weights; InputError when it is damaged."""
        with crew(self.threads) as workers, torch.no_grad():
            parts = [self._decode_block(block, coded.rules, workers) for block in coded.blocks]
        points: Floats = filled(together(parts), coded.per_voxel) + np.array(coded.origin)
        return points * side_of(coded.quarters)

    def _encode_block(self, keys: Keys, workers: Crew) -> Block:
        found = analyse(self.weights.model, keys, workers)
        latent = np.rint(found.latent * self._gain()).astype(np.int32)
        fine, two, four = found.counts
        counts = (max(1, round(self.rho * fine)), two, four, len(found.coarse))
        coordinates = encode_voxels(morton_voxels(found.coarse.keys))
        return Block(counts, coordinates, self._features(latent, found.coarse))

    def _features(self, latent: Integers, coarse: Voxels) -> bytes:
        if Rules.CONTEXTS in self.rules:
            expected = everywhere(self._tables(), len(coarse))
            return encode_in_context(latent, coarse.neighbours, expected)
        return encode_latent(latent, self._tables())

    def _decode_block(self, block: Block, rules: Rules, workers: Crew) -> Octets:
        coarse = pyramid(_coarse_keys(block), 0, workers)[0][0]
        features = self._latent(block, coarse, rules).astype(np.float32) / self._gain()
        network, counts = self.weights.model, block.counts[:3]
        families = Rules.FAMILIES in rules
        return synthesise(network, features, coarse, counts, workers, families)

    def _latent(self, block: Block, coarse: Voxels, rules: Rules) -> Integers:
        if Rules.CONTEXTS in rules:
            expected = everywhere(self._tables(), len(coarse))
            return decode_in_context(block.features, coarse.neighbours, expected)
        return decode_latent(block.features, len(coarse), self._tables())

    def _tables(self) -> tuple[Table, ...]:
        return self.weights.tables[self.rate]

    def _gain(self) -> NDArray[np.float32]:
        gain: NDArray[np.float32] = self.weights.model.gain(self.rate).detach().numpy()
        return gain


def _coarse_keys(block: Block) -> Keys:
    voxels = decode_voxels(block.coordinates)
    if len(voxels) != block.counts[3] or voxels.min() < 0 or voxels.max() >= 2**AXIS_BITS // STRIDE:
        raise InputError("the stream is damaged (coordinates)")
    keys = distinct(morton_keys(voxels))
    if len(keys) != len(voxels):
        raise InputError("the stream is damaged (coordinates)")
    return keys


def split(keys: Keys, most: int) -> list[Keys]:
    """Cut keys, in order, into parts of about equal size and at most `most`, between coarse voxels.

    A coarse voxel has at most 512 children, so a part may be that much larger.
    """
    parts = -(-len(keys) // most)
    borders = np.flatnonzero(np.diff(keys >> 3 * SCALES)) + 1
    wanted = np.arange(1, parts) * len(keys) // parts
    cuts = borders[np.minimum(np.searchsorted(borders, wanted), len(borders) - 1)]
    return [part for part in np.split(keys, np.unique(cuts)) if len(part)]
