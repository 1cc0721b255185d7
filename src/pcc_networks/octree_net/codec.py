from __future__ import annotations

import numpy as np

from gpcc.grid import DEFAULT_GRID, InputGrid, input_coordinates, quantise
from pcc_networks.octree_net.coder import decode_part, encode_part, split
from pcc_networks.octree_net.stream import OctreeNetStream, read_stream, write_stream
from pcc_networks.octree_net.weights import OctreeNetWeights
from pcc_networks.sparse.voxels import AXIS_BITS, morton_keys, morton_voxels, unique_keys
from pcc_networks.weights_file import check_digest
from pointkit.errors import NARROWER, InputError
from pointkit.geometry.cloud import Floats, check_points


def encode(
    points: Floats,
    weights: OctreeNetWeights,
    scale: float = 1.0,
    grid: InputGrid = DEFAULT_GRID,
) -> bytes:
    """Quantise points to a grid of step ``grid.unit / scale``, and encode the voxels losslessly.

    Parameters
    ----------
    points
        (n, 3), n >= 1; quantised as by `gpcc.quantise`; duplicates are merged.
    scale
        Steps of the coded grid per step of the input grid.
    grid
        Grid of the input.

    Raises
    ------
    InputError
        If points are not finite, or span more than 2**20 voxels.
    """
    check_points(points, "octree_net.encode")
    positions, origin = quantise(points, grid, scale, "nearest")
    if positions.max() >= 2**AXIS_BITS:
        raise InputError(f"the cloud spans more than {AXIS_BITS} bits at scale {scale:g}{NARROWER}")
    keys = unique_keys(morton_keys(positions))
    parts = tuple(encode_part(part, weights.model) for part in split(keys))
    x, y, z = origin.tolist()
    return write_stream(OctreeNetStream(weights.digest, scale, (x, y, z), grid, parts))


def decode(stream: bytes, weights: OctreeNetWeights) -> Floats:
    """Return the points (m, 3) of a stream made with these weights."""
    content = read_stream(stream)
    check_digest(weights.digest, content.digest)
    keys = np.concatenate([decode_part(part, weights.model) for part in content.parts])
    units = (morton_voxels(keys) + np.array(content.origin)) / content.scale
    return input_coordinates(units, content.grid)
