from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from gpcc.lossless import decode_voxels, encode_voxels
from pcc_networks.grid_level import choose_grid_level, voxel_size
from pcc_networks.pcgcv1.cubes import (
    STRIDE,
    Bools,
    CodedCubes,
    OccupiedCubes,
    blocks_of,
    cubes_of,
    cubes_with_all_blocks,
    cubes_with_blocks,
    most_likely_per_block,
    occupancy,
    pooled,
    rows_of,
    sibling_blocks_of,
)
from pcc_networks.pcgcv1.entropy_coding import (
    checksum,
    decode_conditional,
    decode_counts,
    decode_hyper,
    encode_conditional,
    encode_counts,
    encode_hyper,
    latent_positions,
)
from pcc_networks.pcgcv1.hyper_prior import TableIndexes, joined
from pcc_networks.pcgcv1.model import Pcgcv1Shape
from pcc_networks.pcgcv1.stream import (
    BATCH,
    CubeBatch,
    Pcgcv1Stream,
    check_work,
    max_sparse,
    read_stream,
    write_stream,
)
from pcc_networks.pcgcv1.weights import Pcgcv1Weights
from pcc_networks.point_reconstruction import (
    SiblingBlocks,
    check_points_per_voxel,
    joined_blocks,
    lossless_blocks,
    points_per_voxel,
    reconstructed_points,
)
from pcc_networks.sparse.thread_pool import ThreadPool, slices, thread_pool
from pcc_networks.sparse.voxels import top_k
from pcc_networks.weights_file import check_made_with, check_rate
from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats, check_points

Voxels = NDArray[np.int64]
Integers = NDArray[np.int32]
T = TypeVar("T")


def encode(
    points: Floats,
    weights: Pcgcv1Weights,
    rate: int = 0,
    *,
    scale: float = 1.0,
    mean_occupied_children: float = 1.0,
    grid_level_offset: float = 0.0,
    rho: float = 1.0,
    min_points: int = 20,
    sparse_cubes: bool = True,
    context_mixing: bool = True,
    point_reconstruction: bool = True,
) -> bytes:
    """Encode points with PCGCv1.

    Parameters
    ----------
    points
        Points (n, 3), n >= 1, in steps of the finest grid. Points are rounded to the grid, and
        points in the same voxel are merged.
    weights
        Weights that `load_weights` returned.
    rate
        Index of the rate in ``weights.lmbdas``; 0 has the fewest bits.
    scale
        Factor by which all coordinates are multiplied first.
    mean_occupied_children
        The grid is coarsened until a voxel of twice the side contains this many voxels on average
        (see `choose_grid_level`). For 1 (the default) or less, the finest grid is kept.
    grid_level_offset
        Octaves by which the grid is then coarsened further, or refined if negative. An octave
        doubles the side of a voxel.
    rho
        Number of decoded voxels per occupied voxel.
    min_points
        Minimum number of voxels in a cube that the network codes.
    sparse_cubes
        Whether to code the voxels of cubes with fewer voxels without loss. If False, they are
        dropped, as in the authors' program.
    context_mixing
        Whether to code the latent with adaptive contexts, which learn from the cloud.
    point_reconstruction
        Whether the decoder shall place about as many points as were encoded, on the surface that
        the decoded voxels show. If False, it places one point at the centre of each voxel.

    Returns
    -------
    bytes
        The stream, which contains all that `decode` needs except the weights.

    Raises
    ------
    InputError
        If points are not finite, exceed 30-bit integers or are all dropped, or if the weights do
        not have the rate.
    """
    check_points(points, "pcgcv1.encode")
    check_rate(weights, rate)
    if np.abs(points).max() * scale >= 2**30:
        raise InputError("coordinates exceed 30-bit integers")
    scale /= voxel_size(
        choose_grid_level(points * scale, mean_occupied_children, grid_level_offset)
    )
    shape = weights.model.shape
    cubes = cubes_of(np.rint(points * scale).astype(np.int64), shape.cube_size)
    is_dense = cubes.counts >= min_points
    sparse = encode_voxels(cubes.selected(~is_dense).voxels()) if sparse_cubes else b""
    kept = cubes.selected(is_dense)
    if not len(kept.counts) and not sparse:
        raise InputError(
            f"no cube has {min_points} points, and sparse ones are dropped (sparse_cubes)"
        )
    counts = np.clip(np.rint(rho * kept.counts), 1, shape.cube_size**3).astype(np.int64)
    positions = blocks_of(kept) if shape.occupied_blocks else kept.positions
    coded_cubes = _coded_cubes(positions, shape)
    batches: tuple[CubeBatch, ...] = ()
    latent, latent_order = b"", None
    if len(counts):
        with thread_pool() as pool:
            parts = [
                _analyse(weights, rate, kept, coded_cubes.blocks[batch], batch.start, pool)
                for batch in slices(len(counts), BATCH)
            ]
        batches, y_hats, indexes = zip(*parts, strict=True)
        latent_order = latent_positions(coded_cubes) if context_mixing else None
        all_indexes = joined(np.concatenate, indexes)
        latent = encode_conditional(np.concatenate(y_hats), all_indexes, latent_order)
    content = Pcgcv1Stream(
        weights.digest,
        rate,
        scale,
        len(counts),
        latent_order is not None,
        points_per_voxel(len(points), len(cubes.keys), rho) if point_reconstruction else 0,
        encode_voxels(positions),
        encode_counts(counts, shape.cube_size**3),
        sparse,
        latent,
        batches,
    )
    check_work(content, shape.cube_size, int(counts.sum()))
    if sparse_cubes and len(cubes.keys) - len(kept.keys) > max_sparse(content):
        raise InputError("the cloud has too many voxels in sparse cubes")
    return write_stream(content)


def decode(stream: bytes, weights: Pcgcv1Weights) -> Floats:
    """Decode a stream that `encode` of PCGCv1 returned.

    The options of the encoder are stored in the stream.

    Parameters
    ----------
    stream
        All bytes that `encode` returned.
    weights
        The weights with which the stream was made.

    Returns
    -------
    ndarray
        Points (m, 3), float64, in the units of the encoded points. With `point_reconstruction`,
        there are about as many as were encoded; without, there is one at the centre of each decoded
        voxel.

    Raises
    ------
    InputError
        If the stream is damaged or was made with other weights, or if this machine computes other
        probabilities than the machine of the encoder.
    """
    content = read_stream(stream)
    check_made_with(weights, content.digest, content.rate)
    shape, density = weights.model.shape, content.points_per_voxel
    check_work(content, shape.cube_size, 0)
    counts = decode_counts(content.counts, content.cubes, shape.cube_size**3)
    check_work(content, shape.cube_size, sum(counts))
    most_positions = (shape.cube_size // STRIDE) ** 3 if shape.occupied_blocks else 1
    positions = decode_voxels(content.positions, content.cubes * most_positions)
    coded_cubes = _coded_cubes(positions, shape)
    if len(coded_cubes.positions) != content.cubes:
        raise InputError("the stream is damaged (positions)")
    sparse = decode_voxels(content.sparse, max_sparse(content))
    if len(sparse) + len(counts) == 0:
        raise InputError("the stream is damaged (it holds no points)")
    check_points_per_voxel(density, len(sparse) + sum(counts))
    points = [reconstructed_points(lossless_blocks(sparse), density)] if len(sparse) else []
    if counts:
        with thread_pool() as pool:
            parts = _synthesise(weights, content, coded_cubes, counts, pool)
        points.append(reconstructed_points(joined_blocks(parts), density))
    return np.concatenate(points) / content.scale


def _analyse(
    weights: Pcgcv1Weights,
    rate: int,
    cubes: OccupiedCubes,
    blocks: Bools,
    first: int,
    pool: ThreadPool,
) -> tuple[CubeBatch, Integers, TableIndexes]:
    """Return a batch's coded hyper-latents, its latents (n, channels) and their table indexes."""

    def code_cube(cube: int) -> tuple[Integers, Integers, TableIndexes]:
        x = occupancy(cubes.keys_of(first + cube), cubes.side)
        y_hat, z_hat = weights.network.analyse(x, rate)
        return y_hat, z_hat, weights.hyper_synthesis.tables(z_hat)

    y_hats, z_hats, tables = zip(*_map_cubes(len(blocks), code_cube, pool), strict=True)
    indexes = joined(np.stack, tables)
    hyper = encode_hyper(np.stack(z_hats), pooled(blocks), weights.tables[rate])
    batch = CubeBatch(checksum(indexes), hyper)
    return batch, rows_of(np.stack(y_hats), blocks), indexes.rows(blocks)


def _synthesise(
    weights: Pcgcv1Weights,
    content: Pcgcv1Stream,
    coded_cubes: CodedCubes,
    counts: list[int],
    pool: ThreadPool,
) -> list[SiblingBlocks]:
    blocks, rate, side = coded_cubes.blocks, content.rate, weights.model.shape.cube_size
    parts = zip(content.batches, slices(content.cubes, BATCH), strict=True)
    indexes = [_indexes(weights, rate, batch, blocks[cubes], pool) for batch, cubes in parts]
    latent_order = latent_positions(coded_cubes) if content.context_mixing else None
    if content.context_mixing and latent_order is None:
        raise InputError("the stream is damaged (contexts)")
    rows = decode_conditional(content.latent, joined(np.concatenate, indexes), latent_order)
    rows_of_cubes = np.split(rows, np.cumsum(blocks.sum(axis=(1, 2, 3)))[:-1])

    def code_cube(cube: int) -> SiblingBlocks:
        y_hat = np.zeros((*blocks.shape[1:], rows.shape[1]), dtype=np.int32)
        y_hat[blocks[cube]] = rows_of_cubes[cube]
        y_hat = np.ascontiguousarray(np.moveaxis(y_hat, -1, 0))
        logits = weights.network.synthesise(y_hat, rate, blocks[cube])
        if weights.model.shape.occupied_blocks:
            keys = most_likely_per_block(logits, blocks[cube], counts[cube])
        else:
            keys = top_k(logits, counts[cube])
        decoded = sibling_blocks_of(logits, keys)
        corner = coded_cubes.positions[cube] * (side // 2)
        return decoded._replace(positions=decoded.positions + corner)

    return _map_cubes(content.cubes, code_cube, pool)


def _indexes(
    weights: Pcgcv1Weights, rate: int, batch: CubeBatch, blocks: Bools, pool: ThreadPool
) -> TableIndexes:
    z_hats = decode_hyper(batch.hyper, pooled(blocks), weights.tables[rate])
    tables = weights.hyper_synthesis.tables
    indexes = joined(np.stack, _map_cubes(len(blocks), lambda k: tables(z_hats[k]), pool))
    if checksum(indexes) != batch.check:
        raise InputError("this machine chose other entropy tables than the encoder's")
    return indexes.rows(blocks)


def _coded_cubes(positions: Voxels, shape: Pcgcv1Shape) -> CodedCubes:
    make = cubes_with_blocks if shape.occupied_blocks else cubes_with_all_blocks
    return make(positions, shape.cube_size)


def _map_cubes(cubes: int, work: Callable[[int], T], pool: ThreadPool) -> list[T]:
    # one thread computes a cube
    return pool.map_chunks(cubes, 1, lambda rows, _: work(rows.start))
