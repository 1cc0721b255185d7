"""Lossless coding of sets of voxels with the octree of G-PCC, in a format that is not G-PCC.

The header holds the minimum corner, the number of voxels and the bit lengths of the bounding box's
sides as base-128 numbers.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpcc import syntax
from gpcc.contexts import initial_contexts
from gpcc.slices import CodedSlice, decode_slice, encode_octree
from gpcc.tree import build_tree, coded_axes
from pointkit.coding.byte_io import Reader, base_128, signed_128
from pointkit.errors import InputError
from pointkit.geometry.morton import MOST_BITS, Ints, morton_points
from pointkit.geometry.spatial_order import bounding_corners

_SPS = syntax.SequenceParameterSet()
_GPS = syntax.GeometryParameterSet(
    qtbt_enabled_flag=1,
    neighbour_avail_boundary_log2_minus1=7,
    adjacent_child_contextualization_enabled_flag=1,
)
_MAX_VOXELS = 1 << 24
_AXES = np.arange(3)


def encode_voxels(voxels: NDArray[Any]) -> bytes:
    """Encode a set of occupied voxels without loss.

    The stream has a short header of its own, and is therefore not a G-PCC stream.

    Parameters
    ----------
    voxels
        Integer coordinates (n, 3), possibly negative, in any order. Repeated voxels count once.

    Returns
    -------
    bytes
        The stream for `decode_voxels`, empty if there are no voxels.

    Raises
    ------
    InputError
        The voxels span more than 21 bits, or more than 16,777,216 are distinct.
    """
    voxels = np.ascontiguousarray(voxels, dtype=np.int64)
    if not len(voxels):
        return b""
    low, high = bounding_corners(voxels)
    x, y, z = (int(size).bit_length() for size in high - low)
    if max(x, y, z) > MOST_BITS or np.abs(low).max() >= 1 << 31:
        raise InputError(f"voxels are more than {MOST_BITS} bits apart, or too far away")
    header = _header((x, y, z))
    tree = build_tree(voxels, low, header.tree_lvl_coded_axis_list)
    if len(tree.keys) > _MAX_VOXELS:
        raise InputError(f"more than {_MAX_VOXELS} voxels")
    numbers = [base_128(len(tree.keys)), base_128(x | y << 5 | z << 10)]
    return b"".join([*map(signed_128, low.tolist()), *numbers]) + encode_octree(tree, header, _GPS)


def decode_voxels(stream: bytes, most: int = _MAX_VOXELS) -> Ints:
    """Decode the voxels of a stream that `encode_voxels` wrote.

    Parameters
    ----------
    stream
        The stream.
    most
        Largest number of voxels to accept.

    Returns
    -------
    ndarray
        int64 (m, 3), distinct, in the order of the octree.

    Raises
    ------
    InputError
        If the stream is damaged, or holds more than `most` voxels.
    """
    if not stream:
        return np.empty((0, 3), dtype=np.int64)
    reader = Reader(stream)
    low = [reader.signed() for _ in range(3)]
    count, sides = reader.number(), reader.number()
    bits = (sides & 31, sides >> 5 & 31, sides >> 10)
    if not 0 < count <= min(most, _MAX_VOXELS) or max(bits) > MOST_BITS:
        raise InputError("packed voxels: the header is damaged")
    coded = CodedSlice(_header(bits), reader.rest(), count)
    codes = decode_slice(coded, _SPS, _GPS, initial_contexts())
    return morton_points(codes, _AXES, np.array(low, dtype=np.int64))


def _header(bits: tuple[int, int, int]) -> syntax.GeometryHeader:
    x, y, z = bits
    axes = coded_axes((max(x, 1), y, z) if max(bits) == 0 else bits, qtbt=True)
    return syntax.GeometryHeader(tree_depth_minus1=len(axes) - 1, tree_lvl_coded_axis_list=axes)
