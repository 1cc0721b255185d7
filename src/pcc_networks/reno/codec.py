"""Encoding of points in millimetres to RENO streams, and decoding.

The grid is that of the authors' program: coordinates relative to a corner, at -131,072 mm on each
axis, are divided by the grid step (posQ in the program) and rounded, ties to even.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pcc_networks.reno.coder import decode_tree, encode_tree
from pcc_networks.reno.stream import RenoStream, read_stream, write_stream
from pcc_networks.reno.weights import RenoWeights
from pcc_networks.sparse.voxels import AXIS_BITS, morton_keys, morton_voxels, unique_keys
from pcc_networks.weights_file import check_digest
from pointkit.errors import NARROWER, InputError
from pointkit.geometry.cloud import Floats, check_points

OFFSET = 131072
"""Distance from the corner of the authors' grid to the origin along each axis, in mm."""


def encode(points: Floats, weights: RenoWeights, posq: float) -> bytes:
    """Quantise points to a grid of step posQ, and encode the voxels losslessly.

    Parameters
    ----------
    points
        (n, 3), n >= 1, in mm. Points of one voxel are merged.
    posq
        Step of the grid in mm, a number in half precision.

    Raises
    ------
    InputError
        If points are not finite or span more than 2**20 voxels, or posQ is not in half precision.
    """
    check_points(points, "reno.encode")
    if float(np.float16(posq)) != posq or posq <= 0:
        raise InputError(f"posQ {posq:g} is not a number in half precision")
    offsets = _grid_offsets(points)
    voxels = np.rint((points + offsets * float(OFFSET)) / posq).astype(np.int64)
    if voxels.max() >= 2**AXIS_BITS:
        needed = f"more than {AXIS_BITS} bits per coordinate at posQ {posq:g}"
        raise InputError(f"the cloud needs {needed}{NARROWER}")
    tree = encode_tree(unique_keys(morton_keys(voxels)), weights)
    x, y, z = offsets.tolist()
    return write_stream(RenoStream(weights.digest, posq, (x, y, z), tree))


def decode(stream: bytes, weights: RenoWeights) -> Floats:
    """Return the points (m, 3), in mm, of a stream made with these weights.

    Raises InputError if the points are wrong because this machine computes differently.
    """
    content = read_stream(stream)
    check_digest(weights.digest, content.digest)
    keys = decode_tree(content.tree, weights)
    corner = np.array(content.offsets) * float(OFFSET)
    points: Floats = morton_voxels(keys) * content.posq - corner
    return points


def _grid_offsets(points: Floats) -> NDArray[np.int64]:
    """Return each axis's distance from the grid's corner to the origin, in units of 131,072 mm.

    The distance is 1, as in the authors' program, unless coordinates exceed +-131,072 mm.
    """
    least, most = points.min(axis=0), points.max(axis=0)
    is_near = (least >= -OFFSET) & (most < OFFSET)
    return np.where(is_near, 1, -np.floor(least / OFFSET)).astype(np.int64)
