"""Recovery of geometric primitives: those of a decoded surface compared with the scene's labels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from puckbench.geometry.closest import closest_surface_points
from puckbench.geometry.cloud import Floats, PointCloud
from puckbench.geometry.mesh import Labels, Mesh, Primitive, labelled_mesh_in_metres
from puckbench.metrics.primitive_differences import COMPARABLE, differences, distances

Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

LEAST_SHARE = 0.001
"""Smallest share of the points on a primitive that is counted, true or found."""
LEAST_OVERLAP = 0.5
"""Intersection over union above which a found primitive matches a true one."""
FREEFORM = "freeform"
"""The kind of a surface that is no primitive: what is found there is neither right nor wrong."""
ALL = "all"


@dataclass(frozen=True)
class Segmentation:
    """The primitive that each of n points lies on: numbers (n,) index `primitives`."""

    numbers: Ints
    primitives: Sequence[Primitive]

    @property
    def kinds(self) -> NDArray[np.object_]:
        """The kind of each primitive, (number of primitives,)."""
        return np.array([primitive.kind for primitive in self.primitives], dtype=object)


def decoded_in_metres(surface: Mesh, cloud: PointCloud) -> Segmentation:
    """`decoded_segmentation` of a decoded surface in the frame of `cloud` and of its points, in m.

    cloud: points on the true surface, with the scale and offset that brought them into the frame.
    """
    scale, offset = cloud.about.get("scale", 1.0), cloud.about.get("offset", (0.0, 0.0, 0.0))
    placed = labelled_mesh_in_metres(surface, scale, np.asarray(offset))
    assert placed.labels is not None  # noqa: S101 (of all codecs that decode surfaces)
    return decoded_segmentation(placed, placed.labels, cloud.to_metres(cloud.xyz))


def decoded_segmentation(mesh: Mesh, labels: Labels, points: Floats) -> Segmentation:
    """The segment of a decoded surface (its `labels`) that is closest to each of `points` (n, 3).

    A segment is an object of the labels: what the codec holds for one piece of surface, whatever
    the number of primitives that it was coded in. Its primitive is the one that most of its area
    is on.
    """
    triangles = closest_surface_points(mesh, points).triangles
    chosen = _largest_primitives(mesh.areas(), labels)
    primitives = [labels.primitives[number] for number in chosen]
    return Segmentation(labels.object_id[triangles].astype(np.int64), primitives)


def _largest_primitives(areas: Floats, labels: Labels) -> Ints:
    """The primitive with the largest area of each object."""
    pairs = np.column_stack([labels.object_id, labels.primitive_id])
    distinct, pair = np.unique(pairs, axis=0, return_inverse=True)
    rising = np.argsort(np.bincount(pair.ravel(), weights=areas), kind="stable")
    chosen = np.zeros(len(labels.objects), np.int64)
    chosen[distinct[rising, 0]] = distinct[rising, 1]
    return chosen


def recovery(true: Segmentation, found: Segmentation, points: Floats) -> list[dict[str, Any]]:
    """Compare what was found with what is true of `points` (n, 3) in metres, kind by kind.

    A true and a found primitive match when they are of one kind and share more than half of the
    points that either has (`LEAST_OVERLAP`): each has at most one match. Primitives with fewer
    than `LEAST_SHARE` of the points, freeform surfaces, and what is found mostly on them, do not
    count.

    One dictionary for each kind that is there, and before them one for all kinds together:
    ``kind``, ``true``, ``found`` and ``matched`` (numbers of primitives), ``precision`` (matched
    of found), ``recall`` (matched of true), ``label_accuracy`` (of the points on true primitives,
    those on their match), and, medians over the matched, ``residual_m`` (root mean square of the
    distances of a true primitive's points to the one found) and the keys of `differences`. A
    number that nothing stands behind is left out.
    """
    table = _Overlaps.of(true, found)
    pairs = [_pair(true, found, points, *pair) for pair in table.matches]
    kinds = [ALL, *sorted(set(table.true_kinds) | set(table.found_kinds))]
    return [_row(kind, table, pairs) for kind in kinds]


@dataclass(frozen=True)
class _Overlaps:
    """Numbers of points on each true (row) and found (column) primitive, and which count.

    matches: true and found numbers of the pairs. right: points of each true primitive that are on
    its match.
    """

    true_sizes: Ints
    right: Ints
    kinds: NDArray[np.object_]
    true_kinds: NDArray[np.object_]
    found_kinds: NDArray[np.object_]
    matches: list[tuple[int, int]]

    @classmethod
    def of(cls, true: Segmentation, found: Segmentation) -> _Overlaps:
        """The overlaps of two segmentations of the same points."""
        table = np.zeros((len(true.primitives), len(found.primitives)), np.int64)
        np.add.at(table, (true.numbers, found.numbers), 1)
        least = LEAST_SHARE * len(true.numbers)
        sizes, found_sizes = table.sum(axis=1), table.sum(axis=0)
        solid = true.kinds != FREEFORM
        counts = solid & (sizes >= least)
        made = (found_sizes >= least) & (2 * table[~solid].sum(axis=0) <= found_sizes)
        union = sizes[:, None] + found_sizes[None, :] - table
        alike = true.kinds[:, None] == found.kinds[None, :]
        matched = (table > LEAST_OVERLAP * union) & alike & counts[:, None] & made[None, :]
        pairs = [(int(row), int(column)) for row, column in zip(*np.nonzero(matched), strict=True)]
        right = np.where(matched, table, 0).sum(axis=1)
        own = true.kinds
        return cls(sizes, right, own, own[counts], found.kinds[made], pairs)


def _pair(
    true: Segmentation, found: Segmentation, points: Floats, row: int, column: int
) -> tuple[str, dict[str, float]]:
    """Kind and differences of a true primitive and its match."""
    one, other = true.primitives[row], found.primitives[column]
    if one.kind not in COMPARABLE:
        return one.kind, {}
    own = points[true.numbers == row]
    residual = float(np.sqrt(np.mean(distances(other, own) ** 2)))
    return one.kind, {"residual_m": residual, **differences(one, other, own.mean(axis=0))}


def _row(
    kind: str, table: _Overlaps, pairs: Sequence[tuple[str, dict[str, float]]]
) -> dict[str, Any]:
    """The row of one kind of primitive, or of all."""
    of_kind = table.kinds == kind if kind != ALL else table.kinds != FREEFORM
    true = int(np.count_nonzero((table.true_kinds == kind) | (kind == ALL)))
    found = int(np.count_nonzero((table.found_kinds == kind) | (kind == ALL)))
    values = [value for name, value in pairs if kind in (name, ALL)]
    matched, on = len(values), int(table.true_sizes[of_kind].sum())
    return {
        "kind": kind,
        "true": true,
        "found": found,
        "matched": matched,
        **({"precision": matched / found} if found else {}),
        **({"recall": matched / true} if true else {}),
        **({"label_accuracy": float(table.right[of_kind].sum() / on)} if on else {}),
        **_medians(values),
    }


def _medians(values: Sequence[dict[str, float]]) -> dict[str, float]:
    names = dict.fromkeys(name for value in values for name in value)
    return {
        name: float(np.median([value[name] for value in values if name in value])) for name in names
    }
