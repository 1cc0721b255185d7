"""Coding a cloud with a set of weights: cubes, network, entropy coding, block by block."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from puckbench.cloud import Floats
from puckbench.codecs.gpcc.lossless import decode_voxels, encode_voxels
from puckbench.codecs.pcgcv1.coding import (
    checksum,
    decode_conditional,
    decode_counts,
    decode_hyper,
    encode_conditional,
    encode_counts,
    encode_hyper,
)
from puckbench.codecs.pcgcv1.cubes import (
    Cubes,
    Whole,
    cubes_of,
    in_order,
    most_likely,
    occupancy,
    within,
)
from puckbench.codecs.pcgcv1.laplace import Chosen
from puckbench.codecs.pcgcv1.stream import BLOCK, Block, Coded
from puckbench.codecs.pcgcv1.weights import WeightSet
from puckbench.codecs.sparse.crew import Crew, crew
from puckbench.errors import InputError

Voxels = NDArray[np.int64]
Integers = NDArray[np.int32]
T = TypeVar("T")
_STRIDE = 4
"""Of the latent; the hyper-latent has twice as much."""


@dataclass(frozen=True)
class Coder:
    """Codes points at one rate of a set of weights.

    scale: voxels per unit. rho: voxels kept for each one that was occupied. min_points: of a cube
    for the network. sparse_cubes: code the points of smaller cubes without loss of voxels; the
    original drops them. threads: as many as PyTorch would use by default.
    """

    weights: WeightSet
    rate: int
    scale: float = 1.0
    rho: float = 1.0
    min_points: int = 20
    sparse_cubes: bool = True
    threads: int | None = None

    def encode(self, points: Floats) -> Coded:
        """Code points (n, 3), n >= 1; InputError when they are too far apart."""
        side = self.weights.shape.side
        cubes = cubes_of(np.rint(points * self.scale).astype(np.int64), side)
        dense = cubes.counts >= self.min_points
        sparse = encode_voxels(cubes.chosen(~dense).voxels()) if self.sparse_cubes else b""
        kept = cubes.chosen(dense)
        counts = np.clip(np.rint(self.rho * kept.counts), 1, side**3).astype(np.int64)
        with crew(self.threads) as workers:
            blocks = tuple(
                self._encode_block(kept, block, workers) for block in _blocks(len(counts))
            )
        positions = encode_voxels(kept.positions) if len(counts) else b""
        return Coded(self.weights.digest, self.rate, self.scale, len(counts), positions,
                     encode_counts(counts, side**3), sparse, blocks)  # fmt: skip

    def _encode_block(self, cubes: Cubes, block: range, workers: Crew) -> Block:
        def one(cube: int) -> tuple[Integers, Integers, Chosen]:
            occupied = occupancy(cubes.keys_of(cube), cubes.side)
            latent, hyper = self.weights.network.analyse(occupied, self.rate)
            return latent, hyper, self.weights.hyper_decoder.tables(hyper)

        latents, hypers, tables = zip(*_each(block, one, workers), strict=True)
        chosen = _joined(tables)
        coded = encode_hyper(np.stack(hypers), self.weights.tables[self.rate])
        return Block(checksum(chosen), coded, encode_conditional(np.stack(latents), chosen))


class Decoder:
    """Decodes a stream made with a set of weights."""

    def __init__(self, weights: WeightSet, threads: int | None = None) -> None:
        self.weights, self.threads = weights, threads

    def decode(self, coded: Coded) -> Floats:
        """The points (m, 3); InputError when the stream is damaged."""
        side = self.weights.shape.side
        counts = decode_counts(coded.counts, coded.cubes, side**3)
        positions = _positions(coded)
        sparse = decode_voxels(coded.sparse)
        if len(sparse) + len(counts) == 0:
            raise InputError("the stream is damaged (it holds no points)")
        parts = [sparse]
        with crew(self.threads) as workers:
            for block, cubes in zip(coded.blocks, _blocks(coded.cubes), strict=True):
                keys = self._decode_block(coded.rate, block, [counts[k] for k in cubes], workers)
                parts += [positions[k] * side + within(found, side)
                          for k, found in zip(cubes, keys, strict=True)]  # fmt: skip
        return np.vstack(parts) / coded.scale

    def _decode_block(
        self, rate: int, block: Block, counts: list[int], workers: Crew
    ) -> list[Whole]:
        latents = self._latents(rate, block, len(counts), workers)

        def one(cube: int) -> Whole:
            logits = self.weights.network.synthesise(latents[cube], rate)
            return most_likely(logits, counts[cube])

        return _each(range(len(counts)), one, workers)

    def _latents(self, rate: int, block: Block, cubes: int, workers: Crew) -> Integers:
        side = self.weights.shape.side // (2 * _STRIDE)
        hypers = decode_hyper(block.hyper, cubes, side, self.weights.tables[rate])
        decoder = self.weights.hyper_decoder
        chosen = _joined(_each(range(cubes), lambda k: decoder.tables(hypers[k]), workers))
        if checksum(chosen) != block.check:
            raise InputError("this machine chose other entropy tables than the encoder's")
        return decode_conditional(block.latent, chosen)


def _blocks(cubes: int) -> list[range]:
    return [range(first, min(first + BLOCK, cubes)) for first in range(0, cubes, BLOCK)]


def _each(cubes: range, work: Callable[[int], T], workers: Crew) -> list[T]:
    """Results of `work` for each cube, in order; a cube is one thread's from beginning to end."""
    return workers.over(len(cubes), 1, lambda rows, _: work(cubes[rows.start]))


def _joined(parts: Iterable[Chosen]) -> Chosen:
    tables, centres = zip(*parts, strict=True)
    return Chosen(np.stack(tables), np.stack(centres))


def _positions(coded: Coded) -> Voxels:
    positions = decode_voxels(coded.positions)
    if len(positions) != coded.cubes:
        raise InputError("the stream is damaged (positions)")
    return in_order(positions)
