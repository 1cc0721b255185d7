from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pointkit.geometry.cloud import Floats, PointCloud
from pointkit.geometry.mesh import Labels, Mesh, Primitive, labelled_mesh_in_metres
from puckbench.geometry.closest import closest_surface_points
from puckbench.metrics.primitive_differences import (
    COMPARABLE,
    distances_to_primitive,
    parameter_differences,
)

Ints = NDArray[np.int64]

MIN_SHARE = 0.001
"""A primitive counts if it has at least this fraction of all points."""
MIN_OVERLAP = 0.5
"""Two primitives match if the intersection of their points exceeds this fraction of the union."""
FREEFORM = "freeform"
"""Kind of a surface that is not a primitive."""
ALL = "all"


@dataclass(frozen=True)
class Segmentation:
    """The assignment of n points to geometric primitives.

    Parameters
    ----------
    numbers
        Index (n,) into `primitives` for each point.
    primitives
        The primitives, of kinds such as "plane", "cylinder" or "freeform".
    """

    numbers: Ints
    primitives: Sequence[Primitive]

    @property
    def kinds(self) -> NDArray[np.object_]:
        """The kind of each primitive, as an array (len(primitives),) of strings."""
        return np.array([primitive.kind for primitive in self.primitives], dtype=object)


def decoded_in_metres(surface: Mesh, cloud: PointCloud) -> Segmentation:
    """Assign points of the true surface to the primitives of a decoded surface.

    Parameters
    ----------
    surface
        Decoded mesh with labels, in the coordinates of `cloud`.
    cloud
        Points on the true surface.

    Returns
    -------
    Segmentation
        The primitive of each point of `cloud`, with parameters in metres.
    """
    scale, offset = cloud.about.get("scale", 1.0), cloud.about.get("offset", (0.0, 0.0, 0.0))
    placed = labelled_mesh_in_metres(surface, scale, np.asarray(offset))
    assert placed.labels is not None  # noqa: S101 (of all codecs that decode surfaces)
    return decoded_segmentation(placed, placed.labels, cloud.to_metres(cloud.xyz))


def decoded_segmentation(mesh: Mesh, labels: Labels, points: Floats) -> Segmentation:
    """Assign points to the primitives of a labelled mesh.

    Each point belongs to the object with the closest triangle, and is assigned to this object's
    largest primitive.

    Parameters
    ----------
    mesh, labels
        Decoded mesh, and the primitive and object of each triangle.
    points
        Points (n, 3) in the coordinates of the mesh.
    """
    triangles = closest_surface_points(mesh, points).triangles
    primitive_ids = _largest_primitives(mesh.areas(), labels)
    primitives = [labels.primitives[number] for number in primitive_ids]
    return Segmentation(labels.object_id[triangles].astype(np.int64), primitives)


def _largest_primitives(areas: Floats, labels: Labels) -> Ints:
    pairs = np.column_stack([labels.object_id, labels.primitive_id])
    distinct, pair = np.unique(pairs, axis=0, return_inverse=True)
    by_area = np.argsort(np.bincount(pair.ravel(), weights=areas), kind="stable")
    largest = np.zeros(len(labels.objects), np.int64)
    largest[distinct[by_area, 0]] = distinct[by_area, 1]
    return largest


def recovery(true: Segmentation, decoded: Segmentation, points: Floats) -> list[dict[str, Any]]:
    """Measure how well a codec recovered the geometric primitives of a scene.

    Two primitives of one kind match if the intersection of their point sets exceeds half of the
    union. These primitives do not count: those with fewer than `MIN_SHARE` of the points, freeform
    surfaces, and decoded primitives that lie mostly on freeform surfaces.

    Parameters
    ----------
    true, decoded
        Assignments of the same points to true and to decoded primitives.
    points
        The points (n, 3), in metres.

    Returns
    -------
    list of dict
        One entry for all kinds together ("all") and one for each ``kind``:

        * ``true``, ``found``, ``matched``: numbers of true, decoded and matched primitives.
        * ``precision``, ``recall``: matched over decoded, and matched over true primitives.
        * ``label_accuracy``: fraction of the points on true primitives that lie on the matching
          decoded primitive.
        * ``residual_m``: RMS distance of a true primitive's points to the match, median over
          matches.
        * the values of `parameter_differences`, medians over matches.
    """
    overlaps = np.zeros((len(true.primitives), len(decoded.primitives)), np.int64)
    np.add.at(overlaps, (true.numbers, decoded.numbers), 1)
    sizes, decoded_sizes = overlaps.sum(axis=1), overlaps.sum(axis=0)
    min_points = MIN_SHARE * len(true.numbers)
    is_primitive = true.kinds != FREEFORM
    is_counted = is_primitive & (sizes >= min_points)
    is_decoded_counted = (decoded_sizes >= min_points) & (
        2 * overlaps[~is_primitive].sum(axis=0) <= decoded_sizes
    )
    union = sizes[:, None] + decoded_sizes - overlaps
    is_match = (overlaps > MIN_OVERLAP * union) & (true.kinds[:, None] == decoded.kinds)
    is_match &= is_counted[:, None] & is_decoded_counted
    points_on_match = np.where(is_match, overlaps, 0).sum(axis=1)
    pairs = [_pair(true, decoded, points, *pair) for pair in np.argwhere(is_match).tolist()]
    kinds, decoded_kinds = true.kinds[is_counted], decoded.kinds[is_decoded_counted]
    table = []
    for kind in (ALL, *sorted({*kinds, *decoded_kinds})):
        of_kind = is_primitive if kind == ALL else true.kinds == kind
        counts = [
            int(np.count_nonzero((each == kind) | (kind == ALL))) for each in (kinds, decoded_kinds)
        ]
        values = [value for name, value in pairs if kind in (name, ALL)]
        row: dict[str, Any] = {"kind": kind, "true": counts[0], "found": counts[1]}
        row["matched"] = len(values)
        if counts[1]:
            row["precision"] = len(values) / counts[1]
        if counts[0]:
            row["recall"] = len(values) / counts[0]
        if of_points := int(sizes[of_kind].sum()):
            row["label_accuracy"] = float(points_on_match[of_kind].sum() / of_points)
        table.append({**row, **_medians(values)})
    return table


def _pair(
    true: Segmentation, decoded: Segmentation, points: Floats, row: int, column: int
) -> tuple[str, dict[str, float]]:
    primitive, match = true.primitives[row], decoded.primitives[column]
    if primitive.kind not in COMPARABLE:
        return primitive.kind, {}
    primitive_points = points[true.numbers == row]
    residual = float(np.sqrt(np.mean(distances_to_primitive(match, primitive_points) ** 2)))
    return primitive.kind, {
        "residual_m": residual,
        **parameter_differences(primitive, match, primitive_points.mean(axis=0)),
    }


def _medians(values: Sequence[dict[str, float]]) -> dict[str, float]:
    names = dict.fromkeys(name for value in values for name in value)
    return {
        name: float(np.median([value[name] for value in values if name in value])) for name in names
    }
