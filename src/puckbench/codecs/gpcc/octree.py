"""One level of the octree: every node's planes, direct points or occupancy, in breadth-first order.

The same kernel codes (given an `Encoder` and a `Source`) and decodes (given a `Decoder` and None).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.codecs.gpcc.arithmetic import code_bit, code_exp_golomb, exhausted
from puckbench.codecs.gpcc.compiled import entry, integer, kernel, part
from puckbench.codecs.gpcc.direct import (
    DirectNode,
    code_direct,
    fits,
    is_candidate,
    local_points,
    placed,
)
from puckbench.codecs.gpcc.models import DUPLICATES_GT0, DUPLICATES_PREFIX, IS_DIRECT, Models
from puckbench.codecs.gpcc.neighbours import (
    Atlas,
    adjacent_children,
    enter_cube,
    face_neighbours,
    face_pattern,
    neighbour_grid,
    predicted_children,
)
from puckbench.codecs.gpcc.occupancy import (
    Planes,
    Surroundings,
    code_occupancy,
    no_plane_known,
)
from puckbench.codecs.gpcc.planar import (
    Node,
    PlanarState,
    code_planes,
    count_planes,
    eligible_axes,
    masked_children,
)
from puckbench.codecs.gpcc.tables import COUNT
from puckbench.core.compiling import inlined
from puckbench.geometry.morton import below

Ints = NDArray[np.int64]
Bytes = NDArray[np.uint8]

EXHAUSTED = -1
TOO_MANY_POINTS = -2


class Level(NamedTuple):
    """What is the same for all nodes of a level.

    axes, parent_axes: axes (4 x, 2 y, 1 z) that the level and the one above it split. bits: log2
    of a node's size along x, y, z. root: whether this is the root's level. last: whether the
    children are leaves. adjacent, predict: whether adjacent children, and prediction from the
    neighbours, choose models. unique: whether duplicate points were merged. direct: inferred
    direct coding mode. joint: of two points together. enabled: mask of candidates, from the
    lowest bit.
    """

    axes: int
    parent_axes: int
    bits: tuple[int, int, int]
    root: bool
    last: bool
    adjacent: bool
    predict: bool
    unique: bool
    direct: int
    joint: bool
    enabled: int


class Nodes(NamedTuple):
    """Nodes that have children: codes, occupancies, children that may be coded directly (a bit
    each) and, in an encoder, the index of the first child among all nodes of its level.
    """

    morton: Ints
    occupancy: Bytes
    eligible: Bytes
    first: NDArray[np.int32]


class Source(NamedTuple):
    """The tree that an encoder codes.

    occupancy, first: of all nodes of a level, and the index of each one's first child below.
    start: index of each one's first leaf, and the number of leaves. leaves: codes of all leaves,
    where points are coded directly. counts: points at each leaf, unless merged.
    """

    occupancy: Bytes
    first: NDArray[np.int32]
    start: NDArray[np.int32]
    leaves: Ints
    counts: NDArray[np.int32]


class Slice(NamedTuple):
    """State that lasts over the levels of a slice.

    atlas, planar: of the contexts. leaves: codes of decoded points. tally: how many there are and
    may be; nodes kept at this level, and their children; mask of candidates for direct coding.
    given, coded: (2, 3), left: (3,), scratch of direct coding.
    """

    atlas: Atlas
    planar: PlanarState
    leaves: Ints
    tally: Ints
    given: Ints
    coded: Ints
    left: Ints


class Family(NamedTuple):
    """A parent as its children see it.

    base: code of its first child. siblings: its occupancy. faces: its children's occupied
    face neighbours. grid: occupied nodes around the children. eligible: children that may be coded
    directly. first: in an encoder, index of its first child among all nodes of the level.
    """

    base: int
    siblings: int
    faces: int
    grid: int
    eligible: int
    first: int


@entry
def code_level(
    coder: Any,
    models: Models,
    level: Level,
    parents: Nodes,
    nodes: Nodes,
    source: Source | None,
    slice_: Slice,
) -> int:
    """Code the children of `parents`; those that have children themselves go into `nodes`.

    Returns how many these are, or a negative fault of the stream.
    """
    cubes, axes, count = slice_.atlas, level.parent_axes, len(parents.morton)
    slice_.tally[2:4] = 0
    slice_.tally[4] = level.enabled
    cube_start, cube_end = 0, 0
    for p in range(count):
        if cubes.side and p == cube_end:
            cube_end = enter_cube(cubes, parents.morton, parents.occupancy, axes, cube_start, p)
            cube_start = p
        siblings = integer(parents.occupancy[p])
        if slice_.planar.enabled and not level.root:
            count_planes(slice_.planar, siblings)
        base = below(parents.morton[p], axes)
        faces = face_neighbours(cubes, axes, base, siblings)
        grid = neighbour_grid(cubes, axes, base) if level.predict else 0
        first = integer(parents.first[p]) if source is not None else 0
        family = Family(base, siblings, faces, grid, integer(parents.eligible[p]), first)
        fault = _code_family(coder, models, level, family, nodes, source, slice_)
        if fault:
            return fault
    if cubes.side:
        enter_cube(cubes, parents.morton, parents.occupancy, axes, cube_start, count)
    return integer(slice_.tally[2])


@part
def _code_family(
    coder: Any,
    models: Models,
    level: Level,
    family: Family,
    nodes: Nodes,
    source: Source | None,
    slice_: Slice,
) -> int:
    """Code the children of one parent; 0, or a negative fault of the stream."""
    index, tally = family.first, slice_.tally
    for child in range(8):
        if family.siblings >> child & 1 == 0:
            continue
        occupancy, pattern = _code_node(coder, models, level, source, slice_, family, child, index)
        if occupancy and level.last:
            _code_leaves(
                coder, models, level, source, slice_, family.base | child, occupancy, index
            )
        elif occupancy:
            kept = tally[2]
            nodes.morton[kept] = family.base | child
            nodes.occupancy[kept] = occupancy
            nodes.eligible[kept] = _eligible(level, family.siblings, pattern, occupancy, tally)
            if source is not None:
                nodes.first[kept] = source.first[index]
            tally[2] += 1
            tally[3] += COUNT[occupancy]
        index += 1
        if exhausted(coder):
            return EXHAUSTED
        if tally[0] + tally[3] > tally[1]:
            return TOO_MANY_POINTS
    return 0


@part
def _code_node(
    coder: Any,
    models: Models,
    level: Level,
    source: Source | None,
    slice_: Slice,
    family: Family,
    child: int,
    index: int,
) -> tuple[int, int]:
    """Code one node: its occupancy, 0 when its points were coded directly; its refined pattern."""
    morton = family.base | child
    pattern = face_pattern(family.faces, child)
    one, two, empty, seen = 0, 0, 0, 0
    if level.adjacent:
        pattern, one, two, empty, seen = adjacent_children(
            slice_.atlas, level.axes, morton, pattern
        )
    occupancy = integer(source.occupancy[index]) if source is not None else 0
    planar, upper, possible = 0, 0, 7
    if slice_.planar.enabled:
        siblings = 0 if level.root else family.siblings
        node = Node(morton, child, siblings, pattern, seen, level.adjacent)
        eligible = eligible_axes(slice_.planar, level.axes)
        planar, upper, possible = code_planes(
            coder, models, slice_.planar, node, eligible, occupancy
        )
    if family.eligible >> child & 1 and _code_directly(
        coder, models, level, source, slice_, morton, index, planar, upper
    ):
        occupancy = 0
    else:
        planes = _planes(level.axes, planar, upper, possible)
        foretold, expected = 0, 0
        if level.predict and no_plane_known(planes):
            foretold, expected = predicted_children(family.grid, child)
        known = integer(slice_.atlas.side > 0)
        around = Surroundings(known, pattern, one, two, empty, foretold, expected)
        occupancy = code_occupancy(coder, models, around, planes, occupancy)
    if level.adjacent:
        slice_.atlas.nodes[morton & ((1 << 3 * slice_.atlas.side) - 1)] = occupancy
    return occupancy, pattern


@inlined
def _planes(axes: int, planar: int, upper: int, possible: int) -> Planes:
    """What is known of a node's planes; along an axis that is not split only the lower exists."""
    planar |= ((axes >> 2 & 1) | (axes & 2) | (axes & 1) << 2) ^ 7
    return Planes(
        masked_children(planar, upper, 0),
        masked_children(planar, upper, 1),
        masked_children(planar, upper, 2),
        possible,
    )


@kernel
def _eligible(level: Level, siblings: int, pattern: int, occupancy: int, tally: Ints) -> int:
    """Children of a node that may be coded directly; turns the mask of candidates in `tally`."""
    if level.direct == 0:
        return 0
    family = 8 if level.root else COUNT[siblings]
    size = max(level.bits[0], level.bits[1], level.bits[2])
    if not is_candidate(level.direct, size, pattern, family, COUNT[occupancy]):
        return 0
    mask, enabled = 0, tally[4]
    for child in range(8):
        if occupancy >> child & 1:
            mask |= (enabled & 1) << child
            enabled = enabled >> 1 | (enabled & 1) << 31
    tally[4] = enabled
    return mask


@kernel
def _code_directly(
    coder: Any,
    models: Models,
    level: Level,
    source: Source | None,
    slice_: Slice,
    morton: int,
    index: int,
    planar: int,
    upper: int,
) -> bool:
    """Code whether a node's points are coded directly and, if so, code them."""
    leaves, points, start, end = 0, 0, 0, 0
    if source is not None:
        start, end = integer(source.start[index]), integer(source.start[index + 1])
        leaves = end - start
        points = leaves if level.unique else _points(source, start, end)
    direct = integer(fits(level.unique, leaves, points))
    if not code_bit(coder, models.probabilities, IS_DIRECT, direct):
        return False
    if source is not None:
        local_points(source.leaves[start:end], level.bits, slice_.given, level.joint)
    node = DirectNode(level.bits, level.unique, level.joint, planar, upper)
    leaves, points = code_direct(
        coder, models, node, slice_.given, leaves, points, slice_.coded, slice_.left
    )
    if source is None:
        for i in range(leaves):
            repeats = points - leaves + 1 if i == 0 else 1
            _put(slice_, placed(morton, level.bits, slice_.coded[i]), repeats)
    return True


@kernel
def _points(source: Source, start: int, end: int) -> int:
    """Points at the leaves from `start` to `end`."""
    points = 0
    for leaf in range(start, end):
        points += source.counts[leaf]
    return points


@kernel
def _code_leaves(
    coder: Any,
    models: Models,
    level: Level,
    source: Source | None,
    slice_: Slice,
    morton: int,
    occupancy: int,
    index: int,
) -> None:
    """Code how many points each leaf of a node of the last level holds; a decoder keeps them."""
    base = below(morton, level.axes)
    leaf = integer(source.first[index]) if source is not None else 0
    for child in range(8):
        if occupancy >> child & 1 == 0:
            continue
        points = integer(1)
        if not level.unique:
            more = integer(source.counts[leaf]) - 1 if source is not None else 0
            if code_bit(coder, models.probabilities, DUPLICATES_GT0, integer(more > 0)):
                points = 2 + code_exp_golomb(
                    coder, models.probabilities, DUPLICATES_PREFIX, more - 1
                )
        if source is None:
            _put(slice_, base | child, points)
        leaf += 1


@kernel
def _put(slice_: Slice, morton: int, points: int) -> None:
    """Keep `points` decoded points at a leaf, as far as there may be so many."""
    done = slice_.tally[0]
    for i in range(done, min(done + points, slice_.tally[1])):
        slice_.leaves[i] = morton
    slice_.tally[0] = done + points
