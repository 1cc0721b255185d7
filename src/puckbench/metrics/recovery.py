"""How well planes are recovered: those found against the labels of a generated scene."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from puckbench.cloud import Floats
from puckbench.mesh import Primitive

Ints = NDArray[np.int64]

LEAST_SHARE = 0.001
"""Primitives that fewer of the points lie on are left out on both sides."""
LEAST_OVERLAP = 0.5
"""Intersection over union from which a found plane stands for a true one."""


def plane_recovery(
    true_labels: NDArray[np.int32], primitives: Sequence[Primitive], found: Ints, planes: Floats
) -> dict[str, float]:
    """Compare the plane found for each of n points (labels (n,), planes (s, 4)) with the true one.

    primitives: the scene's, which `true_labels` (n,) index, in the frame of `planes` (n.p = d).
    A true and a found plane match when they share half of the points that either has; so each has
    at most one match. Returns ``precision`` and ``recall`` (matched among found and among true
    planes that count), ``label_accuracy`` (of the points on true planes, those on their match),
    ``angle_deg`` and ``offset`` (medians over the matched; offset at the plane's true points'
    frame origin, in units of it), ``true_planes``, ``found_planes``.
    """
    flat = np.array([primitive.kind == "plane" for primitive in primitives])
    table = np.zeros((len(primitives), len(planes)), np.int64)
    np.add.at(table, (true_labels, found), 1)
    least = LEAST_SHARE * len(found)
    true_sizes, found_sizes = table.sum(axis=1), table.sum(axis=0)
    union = true_sizes[:, None] + found_sizes[None, :] - table
    matched = (table > LEAST_OVERLAP * union) & flat[:, None]
    rows, columns = np.nonzero(matched & (true_sizes >= least)[:, None])
    angles, offsets = _differences([primitives[int(row)] for row in rows], planes[columns])
    wanted = int(np.count_nonzero(flat & (true_sizes >= least)))
    made = int(np.count_nonzero(found_sizes >= least))
    return {
        "precision": len(rows) / max(made, 1),
        "recall": len(rows) / max(wanted, 1),
        "label_accuracy": float(table[rows, columns].sum() / max(true_sizes[flat].sum(), 1)),
        "angle_deg": float(np.median(angles)) if len(rows) else 0.0,
        "offset": float(np.median(offsets)) if len(rows) else 0.0,
        "true_planes": wanted,
        "found_planes": made,
    }


def _differences(true: Sequence[Primitive], found: Floats) -> tuple[Floats, Floats]:
    """Angles, degrees, and differences of the offsets of pairs of planes."""
    normals = np.array([plane.parameters["normal"] for plane in true]).reshape(-1, 3)
    offsets = np.array([plane.parameters["offset"] for plane in true])
    along = np.einsum("ij,ij->i", normals, found[:, :3])
    angles = np.degrees(np.arccos(np.minimum(np.abs(along), 1.0)))
    return angles, np.abs(offsets - np.sign(along) * found[:, 3])
