from __future__ import annotations

import numpy as np

from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats, check_points
from puckbench.learned.grid_level import choose_grid_level, voxel_size
from puckbench.learned.pcgcv1.coder import Pcgcv1Decoder, Pcgcv1Encoder
from puckbench.learned.pcgcv1.stream import read_stream, write_stream
from puckbench.learned.pcgcv1.weights import Pcgcv1Weights
from puckbench.learned.weights_file import check_made_with, check_rate


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
    threads: int | None = None,
) -> bytes:
    """Encode points with PCGCv1.

    Parameters
    ----------
    points
        (n, 3), n >= 1, in steps of the finest grid.
    rate
        Index of the rate in ``weights.lmbdas``, lowest bitrate first.
    scale
        Voxels per step of the finest grid, before coarsening.
    mean_occupied_children, grid_level_offset
        Choice of the voxel grid, see `choose_grid_level`; by default the input's grid.
    rho
        Decoded voxels per occupied voxel.
    min_points
        Minimum voxels of a cube that the network codes.
    sparse_cubes
        Code cubes with fewer voxels losslessly; the authors drop such cubes.
    context_mixing
        Mix the Laplace distributions of the latent with adaptive contexts.
    point_reconstruction
        Decode as many points as were encoded, instead of voxel centres.
    threads
        Number of threads, by default PyTorch's.

    Raises
    ------
    InputError
        If points are not finite, exceed 30-bit integers, or are all dropped.
    """
    check_points(points, "pcgcv1.encode")
    check_rate(weights, rate)
    if np.abs(points).max() * scale >= 2**30:
        raise InputError("coordinates exceed 30-bit integers")
    level = choose_grid_level(points * scale, mean_occupied_children, grid_level_offset)
    encoder = Pcgcv1Encoder(
        weights,
        rate,
        scale=scale / voxel_size(level),
        rho=rho,
        min_points=min_points,
        sparse_cubes=sparse_cubes,
        threads=threads,
        context_mixing=context_mixing,
        point_reconstruction=point_reconstruction,
    )
    content = encoder.encode(points)
    if not content.cubes and not content.sparse:
        raise InputError(
            f"no cube has {min_points} points, and sparse ones are dropped (sparse_cubes)"
        )
    return write_stream(content)


def decode(stream: bytes, weights: Pcgcv1Weights, threads: int | None = None) -> Floats:
    """Return the points (m, 3) of a stream made with these weights."""
    content = read_stream(stream)
    check_made_with(weights, content.digest, content.rate)
    return Pcgcv1Decoder(weights, threads).decode(content)
