from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats
from puckbench.gpcc.lossless import decode_voxels, encode_voxels
from puckbench.learned.pcgcv1.cubes import (
    OccupiedCubes,
    cubes_of,
    occupancy,
    sibling_blocks_of,
)
from puckbench.learned.pcgcv1.entropy_coding import (
    LatentPositions,
    checksum,
    decode_conditional,
    decode_counts,
    decode_hyper,
    encode_conditional,
    encode_counts,
    encode_hyper,
    latent_positions,
)
from puckbench.learned.pcgcv1.laplace import TableIndexes, joined
from puckbench.learned.pcgcv1.occupied_blocks import (
    STRIDE,
    Bools,
    CodedCubes,
    blocks_of,
    cubes_with_all_blocks,
    cubes_with_blocks,
    most_likely_per_block,
    pooled,
    rows_of,
)
from puckbench.learned.pcgcv1.stream import BATCH, CubeBatch, Pcgcv1Stream, check_work, max_sparse
from puckbench.learned.pcgcv1.weights import Pcgcv1Weights
from puckbench.learned.point_reconstruction import (
    SiblingBlocks,
    check_points_per_voxel,
    joined_blocks,
    lossless_blocks,
    points_per_voxel,
    reconstructed_points,
)
from puckbench.learned.sparse.layers import top_k
from puckbench.learned.sparse.thread_pool import ThreadPool, thread_pool

Voxels = NDArray[np.int64]
Integers = NDArray[np.int32]
T = TypeVar("T")


@dataclass(frozen=True)
class Pcgcv1Encoder:
    """Encoder of points at one rate; the fields are options of `codec.encode`."""

    weights: Pcgcv1Weights
    rate: int
    scale: float = 1.0
    rho: float = 1.0
    min_points: int = 20
    sparse_cubes: bool = True
    threads: int | None = None
    context_mixing: bool = True
    point_reconstruction: bool = True

    def encode(self, points: Floats) -> Pcgcv1Stream:
        side = self.weights.model.shape.cube_size
        cubes = cubes_of(np.rint(points * self.scale).astype(np.int64), side)
        is_dense = cubes.counts >= self.min_points
        sparse = encode_voxels(cubes.selected(~is_dense).voxels()) if self.sparse_cubes else b""
        kept = cubes.selected(is_dense)
        counts = np.clip(np.rint(self.rho * kept.counts), 1, side**3).astype(np.int64)
        positions = blocks_of(kept) if self.weights.model.shape.occupied_blocks else kept.positions
        coded_cubes = _coded_cubes(positions, self.weights)
        with thread_pool(self.threads) as pool:
            parts = [
                self._analyse(kept, coded_cubes.blocks[batch], batch.start, pool)
                for batch in _batches(len(counts))
            ]
        latent_order = latent_positions(coded_cubes) if self.context_mixing else None
        density = 0
        if self.point_reconstruction:
            density = points_per_voxel(len(points), len(cubes.keys), self.rho)
        content = Pcgcv1Stream(
            self.weights.digest,
            self.rate,
            self.scale,
            len(counts),
            latent_order is not None,
            density,
            encode_voxels(positions),
            encode_counts(counts, side**3),
            sparse,
            _encode_latents(parts, latent_order),
            tuple(part.batch for part in parts),
        )
        check_work(content, side, int(counts.sum()))
        if len(cubes.keys) - len(kept.keys) > max_sparse(content) and self.sparse_cubes:
            raise InputError("the cloud has too many voxels in sparse cubes")
        return content

    def _analyse(
        self, cubes: OccupiedCubes, blocks: Bools, first: int, pool: ThreadPool
    ) -> _EncodedBatch:
        def code_cube(cube: int) -> tuple[Integers, Integers, TableIndexes]:
            x = occupancy(cubes.keys_of(first + cube), cubes.side)
            y_hat, z_hat = self.weights.network.analyse(x, self.rate)
            return y_hat, z_hat, self.weights.hyper_synthesis.tables(z_hat)

        y_hats, z_hats, tables = zip(*_map_cubes(len(blocks), code_cube, pool), strict=True)
        indexes = joined(np.stack, tables)
        hyper = encode_hyper(np.stack(z_hats), pooled(blocks), self.weights.tables[self.rate])
        batch = CubeBatch(checksum(indexes), hyper)
        return _EncodedBatch(batch, rows_of(np.stack(y_hats), blocks), indexes.rows(blocks))


class Pcgcv1Decoder:
    def __init__(self, weights: Pcgcv1Weights, threads: int | None = None) -> None:
        self.weights, self.threads = weights, threads

    def decode(self, content: Pcgcv1Stream) -> Floats:
        side = self.weights.model.shape.cube_size
        check_work(content, side, 0)
        counts = decode_counts(content.counts, content.cubes, side**3)
        check_work(content, side, sum(counts))
        blocks = (side // STRIDE) ** 3 if self.weights.model.shape.occupied_blocks else 1
        coded_cubes = _coded_cubes(
            decode_voxels(content.positions, content.cubes * blocks), self.weights
        )
        if len(coded_cubes.positions) != content.cubes:
            raise InputError("the stream is damaged (positions)")
        sparse = decode_voxels(content.sparse, max_sparse(content))
        if len(sparse) + len(counts) == 0:
            raise InputError("the stream is damaged (it holds no points)")
        check_points_per_voxel(content.points_per_voxel, len(sparse) + sum(counts))
        parts = self._decode_cubes(content, coded_cubes, counts)
        density = content.points_per_voxel
        points = [reconstructed_points(lossless_blocks(sparse), density)] if len(sparse) else []
        points += [reconstructed_points(joined_blocks(parts), density)] if parts else []
        return np.concatenate(points) / content.scale

    def _decode_cubes(
        self, content: Pcgcv1Stream, coded_cubes: CodedCubes, counts: list[int]
    ) -> list[SiblingBlocks]:
        side, parts = self.weights.model.shape.cube_size, []
        batches = _batches(content.cubes)
        with thread_pool(self.threads) as pool:
            blocks = [coded_cubes.blocks[cubes] for cubes in batches]
            indexes = [
                self._indexes(content.rate, batch, cube_blocks, pool)
                for batch, cube_blocks in zip(content.batches, blocks, strict=True)
            ]
            latents = _decode_latents(content, indexes, coded_cubes)
            for cubes, cube_blocks, rows in zip(batches, blocks, latents, strict=True):
                decoded_cubes = self._synthesise(
                    content.rate, cube_blocks, rows, counts[cubes], pool
                )
                corners = coded_cubes.positions[cubes] * (side // 2)
                parts += [
                    cube._replace(positions=cube.positions + corner)
                    for cube, corner in zip(decoded_cubes, corners, strict=True)
                ]
        return parts

    def _indexes(
        self, rate: int, batch: CubeBatch, blocks: Bools, pool: ThreadPool
    ) -> TableIndexes:
        z_hats = decode_hyper(batch.hyper, pooled(blocks), self.weights.tables[rate])
        tables = self.weights.hyper_synthesis.tables
        indexes = joined(np.stack, _map_cubes(len(blocks), lambda k: tables(z_hats[k]), pool))
        if checksum(indexes) != batch.check:
            raise InputError("this machine chose other entropy tables than the encoder's")
        return indexes.rows(blocks)

    def _synthesise(
        self, rate: int, blocks: Bools, rows: Integers, counts: list[int], pool: ThreadPool
    ) -> list[SiblingBlocks]:
        y_hats = np.zeros((*blocks.shape, rows.shape[1]), dtype=np.int32)
        y_hats[blocks] = rows

        def code_cube(cube: int) -> SiblingBlocks:
            y_hat = np.ascontiguousarray(np.moveaxis(y_hats[cube], -1, 0))
            logits = self.weights.network.synthesise(y_hat, rate, blocks[cube])
            if self.weights.model.shape.occupied_blocks:
                keys = most_likely_per_block(logits, blocks[cube], counts[cube])
            else:
                keys = top_k(logits, counts[cube])
            return sibling_blocks_of(logits, keys)

        return _map_cubes(len(blocks), code_cube, pool)


@dataclass(frozen=True)
class _EncodedBatch:
    batch: CubeBatch
    y_hat: Integers  # (n, channels)
    indexes: TableIndexes  # tables of y_hat


def _encode_latents(parts: list[_EncodedBatch], positions: LatentPositions | None) -> bytes:
    if not parts:
        return b""
    y_hat = np.concatenate([part.y_hat for part in parts])
    indexes = joined(np.concatenate, [part.indexes for part in parts])
    encode = encode_conditional if positions is None else positions.encode
    return encode(y_hat, indexes)


def _decode_latents(
    content: Pcgcv1Stream, parts: list[TableIndexes], coded_cubes: CodedCubes
) -> list[Integers]:
    if not parts:
        return []
    indexes = joined(np.concatenate, parts)
    positions = latent_positions(coded_cubes) if content.context_mixing else None
    if content.context_mixing and positions is None:
        raise InputError("the stream is damaged (contexts)")
    decode = decode_conditional if positions is None else positions.decode
    ends = np.cumsum([len(part.table) for part in parts])
    return np.split(decode(content.latent, indexes), ends[:-1])


def _coded_cubes(positions: Voxels, weights: Pcgcv1Weights) -> CodedCubes:
    side = weights.model.shape.cube_size
    make = cubes_with_blocks if weights.model.shape.occupied_blocks else cubes_with_all_blocks
    return make(positions, side)


def _batches(cubes: int) -> list[slice]:
    return [slice(first, min(first + BATCH, cubes)) for first in range(0, cubes, BATCH)]


def _map_cubes(cubes: int, work: Callable[[int], T], pool: ThreadPool) -> list[T]:
    # one thread computes a cube
    return pool.map_chunks(cubes, 1, lambda rows, _: work(rows.start))
