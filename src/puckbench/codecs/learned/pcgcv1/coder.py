"""Coding a cloud with a set of weights: cubes, network, entropy coding, block by block."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from puckbench.codecs.gpcc.lossless import decode_voxels, encode_voxels
from puckbench.codecs.learned.pcgcv1.cubes import Cubes, cubes_of, most_likely, occupancy, octets_of
from puckbench.codecs.learned.pcgcv1.entropy_coding import (
    checksum,
    decode_conditional,
    decode_counts,
    decode_hyper,
    encode_conditional,
    encode_counts,
    encode_hyper,
)
from puckbench.codecs.learned.pcgcv1.laplace import Chosen, joined
from puckbench.codecs.learned.pcgcv1.latent_neighbourhood import Cells, cells_of
from puckbench.codecs.learned.pcgcv1.occupied_blocks import (
    Bools,
    Support,
    blocks_of,
    everywhere,
    likeliest,
    pooled,
    rows_of,
    support_of,
)
from puckbench.codecs.learned.pcgcv1.stream import BLOCK, Block, Coded
from puckbench.codecs.learned.pcgcv1.weights import WeightSet
from puckbench.codecs.learned.point_reconstruction import (
    Octets,
    certain,
    check_filling,
    filled,
    points_per_voxel,
    together,
)
from puckbench.codecs.learned.sparse.thread_pool import Crew, crew
from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats

Voxels = NDArray[np.int64]
Integers = NDArray[np.int32]
T = TypeVar("T")


@dataclass(frozen=True)
class Coder:
    """Codes points at one rate of a set of weights.

    scale: voxels per unit. rho: voxels kept for each one that was occupied. min_points: of a cube
    for the network. sparse_cubes: code the points of smaller cubes without loss of voxels; the
    original drops them. threads: as many as PyTorch would use by default. contexts: of the latent;
    otherwise it is coded with the tables that the hyper-latent chooses alone. fill: decode as many
    points as were coded, not one for each voxel.
    """

    weights: WeightSet
    rate: int
    scale: float = 1.0
    rho: float = 1.0
    min_points: int = 20
    sparse_cubes: bool = True
    threads: int | None = None
    contexts: bool = True
    fill: bool = True

    def encode(self, points: Floats) -> Coded:
        """Code points (n, 3), n >= 1; InputError when they are too far apart."""
        side = self.weights.shape.side
        cubes = cubes_of(np.rint(points * self.scale).astype(np.int64), side)
        dense = cubes.counts >= self.min_points
        sparse = encode_voxels(cubes.chosen(~dense).voxels()) if self.sparse_cubes else b""
        kept = cubes.chosen(dense)
        counts = np.clip(np.rint(self.rho * kept.counts), 1, side**3).astype(np.int64)
        placed = blocks_of(kept) if self.weights.shape.supported else kept.positions
        support = _support(placed, self.weights)
        with crew(self.threads) as workers:
            parts = [
                self._analyse(kept, support.blocks[block], block.start, workers)
                for block in _blocks(len(counts))
            ]
        cells = cells_of(support) if self.contexts else None
        per_voxel = points_per_voxel(len(points), len(cubes.keys), self.rho) if self.fill else 0
        return Coded(self.weights.digest, self.rate, self.scale, len(counts), cells is not None,
                     per_voxel, encode_voxels(placed), encode_counts(counts, side**3), sparse,
                     _encode_latents(parts, cells),
                     tuple(part.block for part in parts))  # fmt: skip

    def _analyse(self, cubes: Cubes, held: Bools, first: int, workers: Crew) -> _Part:
        def one(cube: int) -> tuple[Integers, Integers, Chosen]:
            occupied = occupancy(cubes.keys_of(first + cube), cubes.side)
            latent, hyper = self.weights.network.analyse(occupied, self.rate)
            return latent, hyper, self.weights.hyper_decoder.tables(hyper)

        latents, hypers, tables = zip(*_each(len(held), one, workers), strict=True)
        chosen = joined(np.stack, tables)
        coded = encode_hyper(np.stack(hypers), pooled(held), self.weights.tables[self.rate])
        block = Block(checksum(chosen), coded)
        return _Part(block, rows_of(np.stack(latents), held), chosen.rows(held))


class Decoder:
    """Decodes a stream made with a set of weights."""

    def __init__(self, weights: WeightSet, threads: int | None = None) -> None:
        self.weights, self.threads = weights, threads

    def decode(self, coded: Coded) -> Floats:
        """The points (m, 3); InputError when the stream is damaged."""
        side = self.weights.shape.side
        counts = decode_counts(coded.counts, coded.cubes, side**3)
        support = _support(decode_voxels(coded.positions), self.weights)
        if len(support.positions) != coded.cubes:
            raise InputError("the stream is damaged (positions)")
        sparse = decode_voxels(coded.sparse)
        if len(sparse) + len(counts) == 0:
            raise InputError("the stream is damaged (it holds no points)")
        check_filling(coded.per_voxel, len(sparse) + sum(counts))
        parts = []
        with crew(self.threads) as workers:
            blocks = [support.blocks[cubes] for cubes in _blocks(coded.cubes)]
            chosen = [
                self._chosen(coded.rate, block, held, workers)
                for block, held in zip(coded.blocks, blocks, strict=True)
            ]
            latents = _decode_latents(coded, chosen, support)
            for cubes, held, rows in zip(_blocks(coded.cubes), blocks, latents, strict=True):
                found = self._synthesise(coded.rate, held, rows, counts[cubes], workers)
                corners = support.positions[cubes] * (side // 2)
                parts += [
                    cube._replace(places=cube.places + corner)
                    for cube, corner in zip(found, corners, strict=True)
                ]
        points = [filled(certain(sparse), coded.per_voxel)] if len(sparse) else []
        points += [filled(together(parts), coded.per_voxel)] if parts else []
        return np.concatenate(points) / coded.scale

    def _chosen(self, rate: int, block: Block, held: Bools, workers: Crew) -> Chosen:
        """The tables (n, channels) of a block's latent; InputError when damaged."""
        hypers = decode_hyper(block.hyper, pooled(held), self.weights.tables[rate])
        decoder = self.weights.hyper_decoder
        chosen = joined(np.stack, _each(len(held), lambda k: decoder.tables(hypers[k]), workers))
        if checksum(chosen) != block.check:
            raise InputError("this machine chose other entropy tables than the encoder's")
        return chosen.rows(held)

    def _synthesise(
        self, rate: int, held: Bools, rows: Integers, counts: list[int], workers: Crew
    ) -> list[Octets]:
        latents = np.zeros((*held.shape, rows.shape[1]), dtype=np.int32)
        latents[held] = rows

        def one(cube: int) -> Octets:
            latent = np.ascontiguousarray(np.moveaxis(latents[cube], -1, 0))
            logits = self.weights.network.synthesise(latent, rate)
            if self.weights.shape.supported:
                return octets_of(logits, likeliest(logits, held[cube], counts[cube]))
            return octets_of(logits, most_likely(logits, counts[cube]))

        return _each(len(held), one, workers)


@dataclass(frozen=True)
class _Part:
    """What the encoder makes of a block of cubes. latent: (n, channels), where blocks count."""

    block: Block
    latent: Integers
    chosen: Chosen


def _encode_latents(parts: list[_Part], cells: Cells | None) -> bytes:
    if not parts:
        return b""
    latent = np.concatenate([part.latent for part in parts])
    chosen = joined(np.concatenate, [part.chosen for part in parts])
    return encode_conditional(latent, chosen) if cells is None else cells.encode(latent, chosen)


def _decode_latents(coded: Coded, parts: list[Chosen], support: Support) -> list[Integers]:
    if not parts:
        return []
    chosen = joined(np.concatenate, parts)
    cells = cells_of(support) if coded.contexts else None
    if coded.contexts and cells is None:
        raise InputError("the stream is damaged (contexts)")
    decode = decode_conditional if cells is None else cells.decode
    ends = np.cumsum([len(part.table) for part in parts])
    return np.split(decode(coded.latent, chosen), ends[:-1])


def _support(placed: Voxels, weights: WeightSet) -> Support:
    """The cubes and blocks in positions (n, 3) of blocks, or of cubes."""
    side = weights.shape.side
    return support_of(placed, side) if weights.shape.supported else everywhere(placed, side)


def _blocks(cubes: int) -> list[slice]:
    return [slice(first, min(first + BLOCK, cubes)) for first in range(0, cubes, BLOCK)]


def _each(cubes: int, work: Callable[[int], T], workers: Crew) -> list[T]:
    """Results of `work` for each cube, in order; a cube is one thread's from beginning to end."""
    return workers.over(cubes, 1, lambda rows, _: work(rows.start))
