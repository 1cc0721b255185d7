from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from gpcc.lossless import decode_voxels, encode_voxels
from pcc_networks.adaptive_entropy import (
    decode_with_contexts,
    encode_with_contexts,
    factorised_prior,
)
from pcc_networks.entropy_bottleneck import decode_latent, encode_latent
from pcc_networks.grid_level import choose_grid_level, voxel_size, voxelised
from pcc_networks.pcgcv2.inference import analyse, synthesise
from pcc_networks.pcgcv2.model import SCALES
from pcc_networks.pcgcv2.stream import (
    ALL_TOOLS,
    MAX_VOXELS,
    CodedBlock,
    CodingTools,
    Pcgcv2Stream,
    read_stream,
    write_coded,
    write_raw,
)
from pcc_networks.pcgcv2.weights import Pcgcv2Weights
from pcc_networks.point_reconstruction import (
    SiblingBlocks,
    joined_blocks,
    points_per_voxel,
    reconstructed_points,
)
from pcc_networks.sparse.thread_pool import ThreadPool, thread_pool
from pcc_networks.sparse.voxels import (
    AXIS_BITS,
    Keys,
    morton_keys,
    morton_voxels,
    pyramid,
    unique_keys,
)
from pcc_networks.weights_file import check_made_with, check_rate
from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats, check_points

STRIDE = 2**SCALES
_MAX_RAW_POINTS = 64
"""Clouds of up to this many points are stored uncompressed."""


def encode(
    points: Floats,
    weights: Pcgcv2Weights,
    rate: int = 0,
    *,
    mean_occupied_children: float = 1.0,
    grid_level_offset: float = 0.0,
    rho: float = 1.0,
    tools: CodingTools = ALL_TOOLS,
    point_reconstruction: bool = True,
) -> bytes:
    """Encode points with PCGCv2.

    Parameters
    ----------
    points
        Points (n, 3), n >= 1, in steps of the finest grid. Points are rounded to the grid, and
        points in the same voxel are merged. Clouds of up to 64 points are stored without loss.
    weights
        Weights that `load_weights` returned.
    rate
        Index of the rate in ``weights.lmbdas``; 0 has the fewest bits.
    mean_occupied_children
        The grid is coarsened until a voxel of twice the side contains this many voxels on average
        (see `choose_grid_level`). For 1 (the default) or less, the finest grid is kept.
    grid_level_offset
        Octaves by which the grid is then coarsened further, or refined if negative. An octave
        doubles the side of a voxel.
    rho
        Number of decoded voxels per occupied voxel.
    tools
        Coding tools that the authors' program does not have. ``CodingTools(0)`` uses none of them.
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
        If points are not finite, exceed 32-bit integers or span more than 2**20 voxels, or if the
        weights do not have the rate.
    """
    check_points(points, "pcgcv2.encode")
    check_rate(weights, rate)
    if len(points) <= _MAX_RAW_POINTS:
        return write_raw(np.unique(points, axis=0))
    if np.abs(points).max() >= 2**31 - 2**20:
        raise InputError("coordinates exceed 32-bit integers")
    level = choose_grid_level(points, mean_occupied_children, grid_level_offset)
    voxels = voxelised(points, level)
    origin = voxels.min(axis=0) // STRIDE * STRIDE
    if (voxels.max(axis=0) - origin).max() >= 2**AXIS_BITS:
        raise InputError(f"the cloud spans more than {2**AXIS_BITS} voxels")
    keys = unique_keys(morton_keys(voxels - origin))
    with thread_pool() as pool, torch.no_grad():
        parts = split(keys, MAX_VOXELS)
        blocks = tuple(_encode_block(part, weights, rate, rho, tools, pool) for part in parts)
    density = points_per_voxel(len(points), len(keys), rho) if point_reconstruction else 0
    x, y, z = origin.tolist()
    return write_coded(Pcgcv2Stream(weights.digest, rate, (x, y, z), blocks, level, tools, density))


def decode(stream: bytes, weights: Pcgcv2Weights) -> Floats:
    """Decode a stream that `encode` of PCGCv2 returned.

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
        If the stream is damaged, or was made with other weights.
    """
    content = read_stream(stream)
    if not isinstance(content, Pcgcv2Stream):
        return content
    check_made_with(weights, content.digest, content.rate)
    with thread_pool() as pool, torch.no_grad():
        parts = [_decode_block(block, weights, content, pool) for block in content.blocks]
    points = reconstructed_points(joined_blocks(parts), content.points_per_voxel)
    shifted: Floats = points + np.array(content.origin)
    return shifted * voxel_size(content.quarter_octaves)


def _encode_block(
    keys: Keys,
    weights: Pcgcv2Weights,
    rate: int,
    rho: float,
    tools: CodingTools,
    pool: ThreadPool,
) -> CodedBlock:
    analysis = analyse(weights.model, keys, pool)
    y_hat = np.rint(analysis.y * _gain(weights, rate)).astype(np.int32)
    coarse, (stride_1, stride_2, stride_4) = analysis.coarse, analysis.counts
    counts = (max(1, round(rho * stride_1)), stride_2, stride_4, len(coarse))
    tables = weights.tables[rate]
    if CodingTools.CONTEXT_MIXING in tools:
        prior = factorised_prior(tables, len(coarse))
        latent = encode_with_contexts(y_hat, coarse.neighbours, prior)
    else:
        latent = encode_latent(y_hat, tables)
    return CodedBlock(counts, encode_voxels(morton_voxels(coarse.keys)), latent)


def _decode_block(
    block: CodedBlock, weights: Pcgcv2Weights, content: Pcgcv2Stream, pool: ThreadPool
) -> SiblingBlocks:
    coarse = pyramid(_coarse_keys(block), 0, pool)[0][0]
    tables, model = weights.tables[content.rate], weights.model
    if CodingTools.CONTEXT_MIXING in content.tools:
        prior = factorised_prior(tables, len(coarse))
        y_hat = decode_with_contexts(block.latent, coarse.neighbours, prior)
    else:
        y_hat = decode_latent(block.latent, len(coarse), tables)
    y = y_hat.astype(np.float32) / _gain(weights, content.rate)
    child_per_parent = CodingTools.CHILD_PER_PARENT in content.tools
    return synthesise(model, y, coarse, block.counts[:3], pool, child_per_parent)


def _gain(weights: Pcgcv2Weights, rate: int) -> NDArray[np.float32]:
    gain: NDArray[np.float32] = weights.model.gain(rate).detach().cpu().numpy()
    return gain


def _coarse_keys(block: CodedBlock) -> Keys:
    voxels = decode_voxels(block.coordinates, block.counts[3])
    if len(voxels) != block.counts[3] or voxels.min() < 0 or voxels.max() >= 2**AXIS_BITS // STRIDE:
        raise InputError("the stream is damaged (coordinates)")
    keys = unique_keys(morton_keys(voxels))
    if len(keys) != len(voxels):
        raise InputError("the stream is damaged (coordinates)")
    return keys


def split(keys: Keys, max_voxels: int) -> list[Keys]:
    """Split Morton keys into parts of about `max_voxels` that are coded separately.

    Parameters
    ----------
    keys
        Sorted Morton keys (n,) of voxels.
    max_voxels
        Approximate largest number of voxels of a part.

    Returns
    -------
    list of ndarray
        Keys of each part. Voxels in the same 8x8x8 cube stay together.
    """
    parts = -(-len(keys) // max_voxels)
    borders = np.flatnonzero(np.diff(keys >> 3 * SCALES)) + 1
    targets = np.arange(1, parts) * len(keys) // parts
    cuts = borders[np.minimum(np.searchsorted(borders, targets), len(borders) - 1)]
    return [part for part in np.split(keys, np.unique(cuts)) if len(part)]
