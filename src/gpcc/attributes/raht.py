"""Region-adaptive hierarchical transform (RAHT) of attributes, equal to TMC13's bit for bit.

An encoder calls `forward`, which returns quantised coefficients and the values that a decoder
reconstructs. A decoder calls `inverse`, which returns these values. Both functions take ascending
Morton codes. Values and coefficients are (n, c) for c = 1 or 3 components; coefficients are in
coding order (see `residuals`). Reconstructed values are not clipped to the bit depth.

From the root to the points, each block of k children (at most eight) is transformed to its mean,
which the parent's reconstruction gives, and k - 1 coefficients. A prediction, interpolated from the
parent and its neighbours, is also transformed and subtracted from the coefficients. Points with
equal positions are transformed last. Fixed-point numbers have 15 fractional bits; products are
rounded half away from zero.

TMC13 (`RAHT.cpp`) sums attributes in 32 bits, this module in 64 bits. Streams differ if sums exceed
2^31, which needs 33,000 points of 16 bits.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpcc.attributes.quantisation import (
    FRACTION_BITS,
    LEAST_QP,
    Qps,
    halved_up,
    quantised,
    step_sizes,
)
from gpcc.attributes.syntax import AttributeParameterSet
from gpcc.compiled import compiled, entry, integer, kernel
from gpcc.fixed_point import inverse_square_root, square_root
from pointkit.coding.intrinsics import bit_count, leading_zeros
from pointkit.compiling import inlined
from pointkit.geometry.morton import Ints

Rows = NDArray[np.int32]
Thresholds = tuple[int, int] | None
"""raht_prediction_threshold0 and 1, or None without prediction."""

_FRACTION = 15
_HALF = 1 << _FRACTION - 1
_REGION_FRACTION = 4
_SMALL = 4096
"""Roots of smaller numbers are tabulated."""
_DIRECTIONS = 19
"""Number of nodes that share a face or an edge with a node, including the node itself."""


class Coded(NamedTuple):
    coefficients: Rows
    reconstruction: Rows


def prediction_thresholds(aps: AttributeParameterSet) -> Thresholds:
    if not aps.raht_prediction_enabled_flag:
        return None
    return aps.raht_prediction_threshold0, aps.raht_prediction_threshold1


def forward(codes: Ints, attributes: Rows, qps: Qps, thresholds: Thresholds) -> Coded:
    """Transform and quantise attribute values.

    Parameters
    ----------
    codes
        Ascending Morton codes (n,) of the points. Points with equal codes are in decoding order.
    attributes
        Integer values (n, components).
    qps
        Quantisation parameters of the points in this order.
    thresholds
        Least numbers of neighbours at which coefficients are predicted, or None without prediction.

    Returns
    -------
    Coded
        Quantised coefficients in coding order, and the values that a decoder reconstructs.
    """
    coefficients = np.zeros(attributes.shape, dtype=np.int32)
    sums = np.zeros((len(codes) + 1, attributes.shape[1]), dtype=np.int64)
    np.cumsum(attributes, axis=0, out=sums[1:])
    reconstruction = _transform(codes, sums, coefficients, qps, thresholds)
    return Coded(coefficients, reconstruction)


def inverse(codes: Ints, coefficients: Rows, qps: Qps, thresholds: Thresholds) -> Rows:
    """Reconstruct values (n, components) from quantised coefficients, as a decoder does.

    The other arguments are those of `forward`.
    """
    sums = np.empty((0, coefficients.shape[1]), dtype=np.int64)
    return _transform(codes, sums, coefficients, qps, thresholds)


def _block_plan() -> tuple[NDArray[np.uint8], NDArray[np.uint8], NDArray[np.int8]]:
    """Return how the children of a block are transformed, for each of the block's occupancies.

    Children are named by their rank, i.e. the index among the occupied ones.

    Returns
    -------
    pairs
        (256, 13, 2) ranks of the two children that each butterfly combines, then zeros.
    order
        (256, 8) ranks of the children that hold the coefficients, in coding order.
    owners
        (256, 8) rank of the child whose region determines the quantisation of a coefficient, or -1.
    """
    pairs = np.zeros((256, 13, 2), dtype=np.uint8)
    order = np.zeros((256, 8), dtype=np.uint8)
    owners = np.full((256, 8), -1, dtype=np.int8)
    for occupancy in range(256):
        children = [octant for octant in range(8) if occupancy >> octant & 1]
        ranks = {octant: rank for rank, octant in enumerate(children)}
        butterflies = 0
        for axis in (1, 2, 4):
            for low in (octant for octant in range(8) if not octant & axis):
                if {low, low | axis} <= ranks.keys():
                    pairs[occupancy, butterflies] = ranks[low], ranks[low | axis]
                    butterflies += 1
                elif low | axis in ranks:
                    ranks[low] = ranks.pop(low | axis)
        for k, octant in enumerate(o for o in (0, 4, 2, 1, 6, 5, 3, 7) if o in ranks):
            order[occupancy, k] = ranks[octant]
            owners[occupancy, k] = children.index(octant) if octant in children else -1
    return pairs, order, owners


def _adjacency() -> tuple[NDArray[np.int64], NDArray[np.uint8], NDArray[np.uint8]]:
    """Return tables of the neighbours of each child (octant) of a node.

    Returns
    -------
    touching
        (8, 7) direction 0 (the node), then directions of its neighbours that touch the child.
    upwards
        (8, 19) direction from the node to the parent of each neighbour of the child.
    octants
        (8, 19) octant of this neighbour within its parent.
    """
    steps = sorted((s for s in np.ndindex(3, 3, 3) if 1 in s), key=lambda s: 3 - s.count(1))
    touching = np.zeros((8, 7), dtype=np.int64)
    upwards = np.zeros((8, _DIRECTIONS), dtype=np.uint8)
    octants = np.zeros((8, _DIRECTIONS), dtype=np.uint8)
    for octant, corner in enumerate(np.ndindex(2, 2, 2)):
        near = [all(s in (1, 2 * c) for s, c in zip(step, corner, strict=True)) for step in steps]
        touching[octant] = np.flatnonzero(near)
        for k, step in enumerate(steps):
            place = [c + s + 1 for c, s in zip(corner, step, strict=True)]
            upwards[octant, k] = steps.index(tuple(p // 2 for p in place))
            octants[octant, k] = np.ravel_multi_index([p % 2 for p in place], (2, 2, 2))
    return touching, upwards, octants


def _touched(touching: NDArray[np.int64]) -> NDArray[np.uint8]:
    """Return the number and directions of the neighbours that touch a child, for each occupancy."""
    touched = np.zeros((256, _DIRECTIONS), dtype=np.uint8)
    for occupancy in range(1, 256):
        directions = np.unique(touching[[k for k in range(8) if occupancy >> k & 1]])[1:]
        touched[occupancy, 0] = len(directions)
        touched[occupancy, 1 : 1 + len(directions)] = directions
    return touched


_PAIRS, _ORDER, _OWNERS = _block_plan()
_TOUCHING, _UPWARDS, _OCTANTS = _adjacency()
_TOUCHED = _touched(_TOUCHING)
_WEIGHTS = np.array([4] + 6 * [2] + 12 * [1], dtype=np.int64)
_DIVISORS = np.rint(2.0**_FRACTION / np.maximum(np.arange(14), 1)).astype(np.int64)


class _Level(NamedTuple):
    # (m + 1,) first point of each node, then the number of points.
    starts: NDArray[np.int32]
    # first, occupancy: (m,) first child on the level below, and bit mask of the children's octants.
    first: NDArray[np.int32]
    occupancy: NDArray[np.uint8]
    # (m, 19) the node itself and its neighbours; -1 if absent.
    neighbours: NDArray[np.int32]
    # (m,) number of the parent's neighbours that touch the parent's children, plus 1.
    counts: NDArray[np.uint8]
    # means, scaled: (m, c) reconstructed mean; mean times the square root of the number of points,
    # in units of 1/4.
    means: Rows
    scaled: Rows


class _Setting(NamedTuple):
    codes: Ints
    # (n + 1, c) cumulative sums of the points' attributes, or (0, c) in a decoder.
    sums: Ints
    # (n, c) which an encoder writes and a decoder reads.
    coefficients: Rows
    # (n, 2) each node's QP offset at the node's first point, in units of 1/16, or (0, 2).
    offsets: Ints
    # steps, reciprocals: step sizes of all quantisation parameters, see `step_sizes`.
    steps: Ints
    reciprocals: Ints
    # (2, k) square roots and inverse square roots of small numbers.
    roots: Ints
    thresholds: tuple[int, int]
    # (2c, 8) attributes of a block's children, then their prediction.
    buffer: Ints
    # weights, factors: weights (8,) of a block's children, factors (12, 2) of its butterflies.
    weights: Ints
    factors: Ints


def _transform(
    codes: Ints, sums: Ints, coefficients: Rows, qps: Qps, thresholds: Thresholds
) -> Rows:
    count, components = coefficients.shape
    reconstruction = np.empty((count, components), dtype=np.int32)
    if not count:
        return reconstruction
    codes = np.ascontiguousarray(codes, dtype=np.int64)
    layers = qps.layers
    setting = _Setting(
        codes,
        sums,
        coefficients,
        _node_offsets(codes, qps.offsets[qps.region]),
        *step_sizes(np.arange(qps.most + 1)),
        _root_table(min(count, _SMALL) + 2),
        thresholds or (0, 0),
        np.empty((2 * components, 8), dtype=np.int64),
        np.empty(8, dtype=np.int64),
        np.empty((12, 2), dtype=np.int64),
    )
    if count == 1:
        _transform_point(setting, layers[0], reconstruction)
        return reconstruction
    joints = _joints(codes)
    depth = int(joints.max())
    inner = 1 + int(np.count_nonzero(joints > 1))
    memory = [_empty_level(count, inner, components) for _ in range(min(depth, 2) + 1)]
    node = parent = _level(joints, depth, memory[0])
    node.neighbours[:] = np.where(np.arange(_DIRECTIONS) == 0, 0, -1)
    place = 0
    for number, height in enumerate(range(depth - 1, -1, -1), 1):
        level = _level(joints, height, memory[number % 3])
        node, parent, grandparent = level, node, parent
        layer = layers[min(number, len(layers) - 1)]
        predicted = number > 1 and thresholds is not None
        around = (parent, grandparent)
        place = _transform_level(
            setting, node, *around, place, layer, height, number == 1, predicted
        )
    if len(node.starts) > count:
        return node.means
    layer = layers[min(depth, len(layers) - 1)]
    _transform_duplicates(setting, node, place, layer, reconstruction)
    return reconstruction


def _empty_level(count: int, inner: int, components: int) -> _Level:
    return _Level(
        np.empty(count + 1, dtype=np.int32),
        np.empty(inner, dtype=np.int32),
        np.empty(inner, dtype=np.uint8),
        np.empty((inner, _DIRECTIONS), dtype=np.int32),
        np.empty(count, dtype=np.uint8),
        np.zeros((count, components), dtype=np.int32),
        np.zeros((count, components), dtype=np.int32),
    )


def _level(joints: NDArray[np.uint8], height: int, memory: _Level) -> _Level:
    end = _write_starts(joints, height, memory.starts)
    return _Level._make([memory.starts[: end + 1], *(array[:end] for array in memory[1:])])


@entry
def _write_starts(joints: NDArray[np.uint8], height: int, starts: NDArray[np.int32]) -> int:
    count = starts[0] = 0
    for i in range(len(joints)):
        if joints[i] > height:
            count += 1
            starts[count] = i + 1
    starts[count + 1] = len(joints) + 1
    return count + 1


@compiled
def _joints(codes: Ints) -> NDArray[np.uint8]:
    """Return the height of the lowest common ancestor of each two successive points."""
    joints = np.empty(len(codes) - 1, dtype=np.uint8)
    for i in range(len(joints)):
        joints[i] = (66 - leading_zeros(codes[i] ^ codes[i + 1])) // 3
    return joints


@compiled
def _node_offsets(codes: Ints, offsets: Ints) -> Ints:
    """Return each node's mean QP offset at the node's first point, rounded as in TMC13."""
    # Nodes are halved along one axis at a time. A node's offset replaces the offset of its lower
    # half, which has the same first point.
    means = offsets << _REGION_FRACTION
    firsts, joints = np.empty(65, dtype=np.int64), np.empty(65, dtype=np.int64)
    depth = 0
    for i in range(len(offsets) + 1):
        joint = 64
        if 0 < i < len(offsets):
            joint -= leading_zeros(codes[i] ^ codes[i - 1])
        if not joint:
            continue
        while depth > 1 and joints[depth - 1] < joint:
            depth -= 1
            left, right = firsts[depth - 1], firsts[depth]
            for k in range(2):
                means[left, k] = (means[left, k] + means[right, k]) >> 1
        if i < len(offsets):
            firsts[depth], joints[depth] = i, joint
            depth += 1
    return means


@compiled
def _root_table(count: int) -> Ints:
    roots = np.zeros((2, count), dtype=np.int64)
    for i in range(1, count):
        roots[0, i] = square_root(i << 2 * _FRACTION)
        roots[1, i] = inverse_square_root(i)
    return roots


@inlined
def _root(setting: _Setting, number: int) -> int:
    if number < setting.roots.shape[1]:
        return integer(setting.roots[0, number])
    return square_root(number << 2 * _FRACTION)


@inlined
def _inverse_root(setting: _Setting, number: int) -> int:
    if number < setting.roots.shape[1]:
        return integer(setting.roots[1, number])
    return inverse_square_root(number)


@inlined
def _rounded(number: int) -> int:
    return (number + _HALF + (number >> 63)) >> _FRACTION


@inlined
def _over_root(setting: _Setting, number: int, weight: int) -> int:
    shift = (63 - leading_zeros(weight - 1)) >> 1 if weight > 1024 else 0
    factor = _inverse_root(setting, weight) >> (40 - _FRACTION - shift)
    return _rounded((number >> shift) * factor)


@inlined
def _butterfly_factors(setting: _Setting, left: int, right: int) -> tuple[int, int]:
    inverse_root = _inverse_root(setting, left + right)
    a, b = _root(setting, left), _root(setting, right)
    return a * inverse_root >> 40, b * inverse_root >> 40


@inlined
def _low_and_high(left: int, right: int, a: int, b: int) -> tuple[int, int]:
    return _rounded(right * b) + _rounded(left * a), _rounded(right * a) - _rounded(left * b)


@inlined
def _left_and_right(low: int, high: int, a: int, b: int) -> tuple[int, int]:
    return _rounded(low * a) - _rounded(high * b), _rounded(low * b) + _rounded(high * a)


@inlined
def _qps(setting: _Setting, layer: Ints, point: int) -> tuple[int, int]:
    first, others = layer[0], layer[1]
    if point >= 0 and len(setting.offsets):
        first += setting.offsets[point, 0] >> _REGION_FRACTION
        others += setting.offsets[point, 1] >> _REGION_FRACTION
    most = len(setting.steps) - 1
    first = min(max(first, LEAST_QP), most)
    return first, min(max(first + others, LEAST_QP), most)


@inlined
def _scaled(setting: _Setting, coefficient: int, qp: int) -> int:
    return halved_up(coefficient * setting.steps[qp], FRACTION_BITS)


@entry
def _transform_point(setting: _Setting, layer: Ints, reconstruction: Rows) -> None:
    coefficients = setting.coefficients
    qp, others = _qps(setting, layer, 0)
    for k in range(coefficients.shape[1]):
        if len(setting.sums):
            coefficients[0, k] = quantised(
                setting.sums[1, k] << FRACTION_BITS, setting.reciprocals[qp]
            )
        reconstruction[0, k] = _scaled(setting, integer(coefficients[0, k]), qp)
        qp = others


@entry
def _transform_level(
    setting: _Setting,
    nodes: _Level,
    parents: _Level,
    grandparents: _Level,
    place: int,
    layer: Ints,
    height: int,
    root: bool,
    predicted: bool,
) -> int:
    node = grandparent = 0
    for parent in range(len(parents.counts)):
        first, occupancy = node, 0
        while nodes.starts[node] < parents.starts[parent + 1]:
            occupancy |= 1 << ((setting.codes[nodes.starts[node]] >> 3 * height) & 7)
            node += 1
        parents.first[parent], parents.occupancy[parent] = first, occupancy
        reliable, count = False, _DIRECTIONS
        if predicted:
            count = 0
            if parents.counts[parent] >= setting.thresholds[0]:
                while grandparents.starts[grandparent + 1] <= parents.starts[parent]:
                    grandparent += 1
                octant = (setting.codes[parents.starts[parent]] >> 3 * (height + 1)) & 7
                count = _find_neighbours(parents, parent, grandparents, grandparent, octant)
                reliable = count >= setting.thresholds[1]
        for child in range(first, node):
            nodes.counts[child] = count
        if node == first + 1 and not root:
            for k in range(parents.means.shape[1]):
                _reconstruct(setting, nodes, first, k, integer(parents.scaled[parent, k]) << 13)
        else:
            place = _transform_block(
                setting, nodes, first, parents, parent, place, layer, root, reliable
            )
    return place


@kernel
def _find_neighbours(
    parents: _Level, parent: int, grandparents: _Level, grandparent: int, octant: int
) -> int:
    """Write a parent and those neighbours that touch a child; return the number of these nodes."""
    # Entries of other directions are neither written nor read.
    occupancy = integer(parents.occupancy[parent])
    parents.neighbours[parent, 0] = parent
    count = integer(1)
    for i in range(_TOUCHED[occupancy, 0]):
        k = _TOUCHED[occupancy, 1 + i]
        other = integer(grandparents.neighbours[grandparent, _UPWARDS[octant, k]])
        there, place = integer(_OCTANTS[octant, k]), max(other, 0)
        around = integer(grandparents.occupancy[place])
        exists = integer(other >= 0) & around >> there
        rank = integer(bit_count(around & ((1 << there) - 1)))
        neighbour = integer(grandparents.first[place]) + rank
        parents.neighbours[parent, k] = neighbour if exists else -1
        count += exists
    return count


@inlined
def _prediction(
    setting: _Setting, parents: _Level, parent: int, octant: int, weight: int
) -> tuple[int, int, int]:
    """Interpolate a child's attributes from its parent and neighbours with similar values."""
    means = parents.means
    low = high = share = first = second = third = integer(0)
    for i in range(_TOUCHING.shape[1]):
        direction = _TOUCHING[octant, i]
        other = parents.neighbours[parent, direction]
        if other < 0:
            continue
        mean = integer(means[other, 0])
        if not direction:
            low, high = 2 * mean, 25 * mean
        elif not low < 10 * mean < high:
            continue
        share += _WEIGHTS[direction]
        first += _WEIGHTS[direction] * mean
        if means.shape[1] > 1:
            second += _WEIGHTS[direction] * integer(means[other, 1])
            third += _WEIGHTS[direction] * integer(means[other, 2])
    factor, root = _DIVISORS[share], _root(setting, weight) if weight > 1 else 1 << _FRACTION
    return (
        _rounded(_rounded((first << _FRACTION) * factor) * root),
        _rounded(_rounded((second << _FRACTION) * factor) * root),
        _rounded(_rounded((third << _FRACTION) * factor) * root),
    )


@kernel
def _transform_block(
    setting: _Setting,
    nodes: _Level,
    first: int,
    parents: _Level,
    parent: int,
    place: int,
    layer: Ints,
    root: bool,
    reliable: bool,
) -> int:
    components = parents.means.shape[1]
    occupancy = integer(parents.occupancy[parent])
    children = bit_count(occupancy)
    _fill_buffer(setting, nodes, first, parents, parent, reliable)
    low = 0 if len(setting.sums) else components
    butterflies = _transform_rows(
        setting, occupancy, low, 2 * components if reliable else components
    )
    for i in range(0 if root else 1, children):
        owner = integer(_OWNERS[occupancy, i])
        point = integer(nodes.starts[first + owner]) if owner >= 0 else -1
        _code_coefficients(setting, place, layer, _ORDER[occupancy, i], point)
        place += 1
    for k in range(components):
        row = components + k
        if not root:
            setting.buffer[row, 0] = integer(parents.scaled[parent, k]) << _FRACTION - 2
        for i in range(butterflies - 1, -1, -1):
            left, right = _PAIRS[occupancy, i, 0], _PAIRS[occupancy, i, 1]
            setting.buffer[row, left], setting.buffer[row, right] = _left_and_right(
                *(setting.buffer[row, left], setting.buffer[row, right]),
                *(setting.factors[i, 0], setting.factors[i, 1]),
            )
        for i in range(children):
            _reconstruct(setting, nodes, first + i, k, setting.buffer[row, i])
    return place


@inlined
def _fill_buffer(
    setting: _Setting, nodes: _Level, first: int, parents: _Level, parent: int, reliable: bool
) -> None:
    """Write each child's weight, its mean times sqrt(weight), and a prediction of this product."""
    buffer, components = setting.buffer, parents.means.shape[1]
    rank = 0
    for octant in range(8):
        if not integer(parents.occupancy[parent]) >> octant & 1:
            continue
        start, end = nodes.starts[first + rank], nodes.starts[first + rank + 1]
        weight = integer(end - start)
        setting.weights[rank] = weight
        for k in range(components):
            if len(setting.sums):
                total = (setting.sums[end, k] - setting.sums[start, k]) << _FRACTION
                buffer[k, rank] = _over_root(setting, total, weight) if weight > 1 else total
            buffer[components + k, rank] = 0
        if reliable:
            a, b, c = _prediction(setting, parents, parent, octant, weight)
            buffer[components, rank] = a
            if components > 1:
                buffer[components + 1, rank], buffer[components + 2, rank] = b, c
        rank += 1


@inlined
def _transform_rows(setting: _Setting, occupancy: int, low: int, high: int) -> int:
    """Transform rows `low` to `high` of the buffer, and return the number of butterflies."""
    buffer, weights = setting.buffer, setting.weights
    count = 0
    while _PAIRS[occupancy, count, 1]:
        left, right = _PAIRS[occupancy, count, 0], _PAIRS[occupancy, count, 1]
        a, b = _butterfly_factors(setting, weights[left], weights[right])
        setting.factors[count, 0], setting.factors[count, 1] = a, b
        weights[left] += weights[right]
        weights[right] = weights[left]
        for k in range(low, high):
            buffer[k, left], buffer[k, right] = _low_and_high(
                buffer[k, left], buffer[k, right], a, b
            )
        count += 1
    return count


@inlined
def _code_coefficients(setting: _Setting, place: int, layer: Ints, rank: int, point: int) -> None:
    """If encoding, quantise residuals; always add the dequantised residuals to the prediction."""
    coefficients, buffer = setting.coefficients, setting.buffer
    components = coefficients.shape[1]
    qp, others = _qps(setting, layer, point)
    for k in range(components):
        if len(setting.sums):
            residual = _rounded(buffer[k, rank] - buffer[components + k, rank])
            coefficients[place, k] = quantised(residual << FRACTION_BITS, setting.reciprocals[qp])
        residual = _scaled(setting, integer(coefficients[place, k]), qp)
        buffer[components + k, rank] += residual << _FRACTION
        qp = others


@inlined
def _reconstruct(setting: _Setting, nodes: _Level, node: int, k: int, value: int) -> None:
    weight = integer(nodes.starts[node + 1] - nodes.starts[node])
    nodes.scaled[node, k] = _rounded(value << 2)
    nodes.means[node, k] = _rounded(_over_root(setting, value, weight) if weight > 1 else value)


@entry
def _transform_duplicates(
    setting: _Setting,
    nodes: _Level,
    place: int,
    layer: Ints,
    reconstruction: Rows,
) -> None:
    """Transform the points at each position, where the last point is split off first."""
    coefficients = setting.coefficients
    for node in range(len(nodes.counts)):
        start = integer(nodes.starts[node])
        weight = nodes.starts[node + 1] - start
        qp, others = _qps(setting, layer, start)
        for k in range(coefficients.shape[1]):
            value = integer(nodes.means[node, k])
            if weight > 1:
                low = _rounded((value << _FRACTION) * _root(setting, weight))
                for before in range(weight - 1, 0, -1):
                    a, b = _butterfly_factors(setting, before, 1)
                    row = place + weight - 1 - before
                    if len(setting.sums):
                        last = setting.sums[start + before + 1, k] - setting.sums[start + before, k]
                        total = setting.sums[start + before, k] - setting.sums[start, k]
                        left = _over_root(setting, total << _FRACTION, before)
                        high = _low_and_high(left, last << _FRACTION, a, b)[1]
                        coefficients[row, k] = quantised(
                            _rounded(high) << FRACTION_BITS, setting.reciprocals[qp]
                        )
                    residual = _scaled(setting, integer(coefficients[row, k]), qp)
                    low, high = _left_and_right(low, residual << _FRACTION, a, b)
                    reconstruction[start + before, k] = _rounded(high)
                value = _rounded(low)
            reconstruction[start, k] = value
            qp = others
        place += weight - 1
