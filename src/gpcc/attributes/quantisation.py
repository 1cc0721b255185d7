from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpcc.attributes.syntax import LIFTING, AttributeHeader, AttributeParameterSet
from gpcc.compiled import integer
from gpcc.kd_tree import Int32s
from pointkit.compiling import inlined
from pointkit.geometry.morton import Ints

FRACTION_BITS = 8
"""Number of fractional bits of weights, step sizes and transformed values."""
_STEPS = (161, 181, 203, 228, 256, 287)
_RECIPROCALS = (416825, 370767, 330586, 294337, 262144, 233829)
LEAST_QP = 4
_LIFTING_QP_OFFSET = 6 * FRACTION_BITS // 2
_RECIPROCAL_BITS = 18 + FRACTION_BITS
_THIRD = (1 << _RECIPROCAL_BITS) // 3


class Qps(NamedTuple):
    """Quantisation parameters (QPs) of a data unit."""

    # (layers, 2) parameters of the first component, and offsets of the other components.
    layers: Ints
    # (1 + regions, 2) offsets, first outside all regions, then in each region.
    offsets: Ints
    # (n,) each point's index into `offsets`, or empty without regions.
    region: NDArray[np.uint8]
    # Maximum parameter.
    most: int
    fixed_point_offset: int

    def ordered(self, indices: NDArray[np.int32]) -> Qps:
        return self._replace(region=self.region[indices] if len(self.region) else self.region)


class Quantisers(NamedTuple):
    """Step sizes (layers, 1 + regions, 2), and their reciprocals in units of 2^-18."""

    steps: Ints
    reciprocals: Ints
    region: NDArray[np.uint8]


def qps(
    aps: AttributeParameterSet,
    header: AttributeHeader,
    bitdepth: int,
    positions: Int32s,
    axes: tuple[int, int, int],
) -> Qps:
    """Return the quantisation parameters of the points of a slice.

    Parameters
    ----------
    aps, header
        Parameter set of the attribute, and header of the data unit.
    bitdepth
        Number of bits of a value.
    positions
        Coordinates (n, 3) along the coded axes, which decide the region that a point is in.
    axes
        Indices of x, y and z among the coded axes.
    """
    luma, chroma = aps.init_qp_minus4 + 4, aps.aps_chroma_qp_offset
    if aps.aps_slice_qp_deltas_present_flag:
        luma, chroma = luma + header.attr_qp_delta_luma, chroma + header.attr_qp_delta_chroma
    layers = [(luma + a, chroma + b) for a, b in header.layer_qp_deltas or [(0, 0)]]
    offsets = [(0, 0)] + [(region.qp_offset, region.chroma_qp_offset) for region in header.regions]
    region_of = np.zeros(len(positions) if header.regions else 0, dtype=np.uint8)
    for index in range(len(header.regions) - 1, -1, -1):
        region = header.regions[index]
        inside = np.ones(len(positions), dtype=bool)
        for axis, low, size in zip(axes, region.origin, region.size_minus1, strict=True):
            inside &= (positions[:, axis] >= low) & (positions[:, axis] <= low + size + 1)
        region_of[inside] = index + 1
    return Qps(
        np.clip(np.array(layers, dtype=np.int64), -(1 << 30), 1 << 30),
        np.clip(np.array(offsets, dtype=np.int64), -(1 << 30), 1 << 30),
        region_of,
        51 + 6 * (bitdepth - 8),
        _LIFTING_QP_OFFSET if aps.attr_encoding == LIFTING else 0,
    )


def quantisers(parameters: Qps) -> Quantisers:
    first = parameters.layers[:, None, 0] + parameters.offsets[None, :, 0]
    first = np.clip(first, LEAST_QP, parameters.most)
    others = parameters.layers[:, None, 1] + parameters.offsets[None, :, 1] + first
    others = np.clip(others, LEAST_QP, parameters.most)
    qp = np.stack([first, others], axis=2) + parameters.fixed_point_offset
    return Quantisers(*step_sizes(qp), parameters.region)


def step_sizes(qp: Ints) -> tuple[Ints, Ints]:
    return (
        np.array(_STEPS, dtype=np.int64)[qp % 6] << qp // 6,
        np.array(_RECIPROCALS, dtype=np.int64)[qp % 6] >> qp // 6,
    )


@inlined
def place_of(
    i: int, layer: int, level: int, ends: Ints, quantisers: Quantisers, order: NDArray[np.int32]
) -> tuple[int, int, int]:
    """Return the layer of step sizes, the level of detail and the region of a point.

    Parameters
    ----------
    i
        Index of the point in coding order.
    layer, level
        Layer and level of the point before.
    ends
        Ends of the levels in coding order.
    """
    if i == ends[layer]:
        layer = min(len(quantisers.steps) - 1, layer + 1)
    if i == ends[level]:
        level += 1
    region = integer(quantisers.region[order[i]]) if len(quantisers.region) else 0
    return layer, level, region


@inlined
def quantised(value: int, reciprocal: int) -> int:
    """Return a quantised value, rounded away from 0 if the fraction is at least 2/3.

    The value has `FRACTION_BITS` fractional bits.
    """
    if value >= 0:
        return (value * reciprocal + _THIRD) >> _RECIPROCAL_BITS
    return -((_THIRD - value * reciprocal) >> _RECIPROCAL_BITS)


@inlined
def halved_up(value: int, shift: int) -> int:
    return (value + (1 << shift >> 1)) >> shift
