from __future__ import annotations

import numpy as np

from puckbench.core.errors import NARROWER, InputError
from puckbench.geometry.cloud import Floats, check_points
from puckbench.gpcc.grid import DEFAULT_GRID, InputGrid, input_coordinates, quantise
from puckbench.learned.octree_net.coder import OctreeNetCoder, split
from puckbench.learned.octree_net.stream import OctreeNetStream, read_stream, write_stream
from puckbench.learned.octree_net.weights import OctreeNetWeights
from puckbench.learned.sparse.voxels import AXIS_BITS, morton_keys, morton_voxels, unique_keys
from puckbench.learned.weights_file import check_digest


def encode(
    points: Floats,
    weights: OctreeNetWeights,
    scale: float = 1.0,
    grid: InputGrid = DEFAULT_GRID,
    threads: int | None = None,
) -> bytes:
    """Quantise points to a grid of step ``grid.unit / scale``, and encode the voxels losslessly.

    Parameters
    ----------
    points
        (n, 3), n >= 1; quantised as by `puckbench.gpcc.quantise`; duplicates are merged.
    scale
        Steps of the coded grid per step of the input grid.
    grid
        Grid of the input.
    threads
        Number of threads, by default PyTorch's.

    Raises
    ------
    InputError
        If points are not finite, or span more than 2**20 voxels.
    """
    check_points(points, "octree_net.encode")
    positions, origin = quantise(points, grid, scale, "nearest")
    if positions.max() >= 2**AXIS_BITS:
        raise InputError(f"the cloud spans more than {AXIS_BITS} bits at scale {scale:g}{NARROWER}")
    coder = OctreeNetCoder(weights.model, threads)
    parts = tuple(coder.encode(keys) for keys in split(unique_keys(morton_keys(positions))))
    x, y, z = origin.tolist()
    return write_stream(OctreeNetStream(weights.digest, scale, (x, y, z), grid, parts))


def decode(stream: bytes, weights: OctreeNetWeights, threads: int | None = None) -> Floats:
    """Return the points (m, 3) of a stream made with these weights."""
    content = read_stream(stream)
    check_digest(weights.digest, content.digest)
    return decoded_points(content, weights, threads)


def decoded_points(
    content: OctreeNetStream, weights: OctreeNetWeights, threads: int | None = None
) -> Floats:
    coder = OctreeNetCoder(weights.model, threads)
    keys = np.concatenate([coder.decode(part) for part in content.parts])
    units = (morton_voxels(keys) + np.array(content.origin)) / content.scale
    return input_coordinates(units, content.grid)
