from __future__ import annotations

import numpy as np

from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats, check_points
from puckbench.learned.grid_level import choose_grid_level, voxelised
from puckbench.learned.pcgcv2.coder import Pcgcv2Coder
from puckbench.learned.pcgcv2.stream import (
    ALL_TOOLS,
    CodingTools,
    Pcgcv2Stream,
    read_stream,
    write_coded,
    write_raw,
)
from puckbench.learned.pcgcv2.weights import Pcgcv2Weights
from puckbench.learned.weights_file import check_made_with, check_rate

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
    threads: int | None = None,
) -> bytes:
    """Encode points with PCGCv2.

    Parameters
    ----------
    points
        (n, 3), n >= 1, in steps of the finest grid.
    rate
        Index of the rate in ``weights.lmbdas``, lowest bitrate first.
    mean_occupied_children, grid_level_offset
        Choice of the voxel grid, see `choose_grid_level`; by default the input's grid.
    rho
        Decoded voxels per occupied voxel.
    point_reconstruction
        Decode as many points as were encoded, instead of voxel centres.
    threads
        Number of threads, by default PyTorch's.

    Raises
    ------
    InputError
        If points are not finite, exceed 32-bit integers, or span more than 2**20 voxels.
    """
    check_points(points, "pcgcv2.encode")
    check_rate(weights, rate)
    if len(points) <= _MAX_RAW_POINTS:
        return write_raw(np.unique(points, axis=0))
    if np.abs(points).max() >= 2**31 - 2**20:
        raise InputError("coordinates exceed 32-bit integers")
    level = choose_grid_level(points, mean_occupied_children, grid_level_offset)
    coder = Pcgcv2Coder(
        weights,
        rate,
        rho,
        threads=threads,
        tools=tools,
        point_reconstruction=point_reconstruction,
    )
    return write_coded(coder.encode(voxelised(points, level), level))


def decode(stream: bytes, weights: Pcgcv2Weights, threads: int | None = None) -> Floats:
    """Return the points (m, 3) of a stream made with these weights."""
    content = read_stream(stream)
    if not isinstance(content, Pcgcv2Stream):
        return content
    check_made_with(weights, content.digest, content.rate)
    return Pcgcv2Coder(weights, content.rate, threads=threads).decode(content)
