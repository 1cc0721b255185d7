"""Clouds that the user names with ``decode --like``, because a stream was coded from them.

By them, decoded points get their original coordinates and attributes.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cloud_files.clouds import SUFFIXES, checked_cloud, read_cloud, read_unchecked_cloud
from cloud_files.content import plain_suffix
from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats, PointCloud, bounds
from puckbench.geometry.matching import share_beyond

MOST_UNLIKE = 0.5
"""Largest allowed share of decoded points that lie near no original point."""
_SAME = 1e-5
"""Largest distance of points that count as equal, as a share of the cloud's extent."""
_MARGIN, _FAR = 0.25, 1.0
"""Margins around a cloud's bounding box, as shares of the box's longest side.

Most points of the other cloud must lie within the first margin, and all within the second.
"""


class Model(NamedTuple):
    """A cloud that the user named with ``--like``.

    Parameters
    ----------
    path
        File of the cloud.
    cloud
        The cloud: a prepared cloud in its coordinate frame, or an original cloud in metres.
    factor
        Factor by which the coordinates of an original cloud were multiplied after reading.
    """

    path: Path
    cloud: PointCloud
    factor: float = 1.0


def read_models(paths: tuple[Path, ...]) -> tuple[Model | None, Model | None]:
    """Read the clouds that the user named with ``--like``.

    Parameters
    ----------
    paths
        At most one prepared cloud and one original cloud, in any order.

    Returns
    -------
    prepared, original
        The clouds, or None for one that is not named. The original's coordinates are multiplied by
        the unit, in m, with which the prepared cloud was made.

    Raises
    ------
    InputError
        There are two clouds of one kind, or most points of the prepared cloud are not points of the
        original.
    """
    plys = {
        path: read_cloud(path, keep_missing=True)
        for path in paths
        if plain_suffix(path) not in SUFFIXES[1:]
    }
    prepared = [Model(path, cloud) for path, cloud in plys.items() if cloud.frame is not None]
    originals = [path for path in paths if path not in [model.path for model in prepared]]
    if max(len(prepared), len(originals)) > 1:
        raise InputError("--like: takes one prepared cloud and one original")
    unit = prepared[0].cloud.metres_per_unit if prepared else 1.0
    read = [_original(path, plys.get(path), unit) for path in originals]
    if prepared and read:
        _check_source(prepared[0], read[0])
    return next(iter(prepared), None), next(iter(read), None)


def _original(path: Path, cloud: PointCloud | None, unit_m: float) -> Model:
    if cloud is None:
        read = read_unchecked_cloud(path, keep_missing=True, convert=unit_m == 1)
        cloud = checked_cloud(read, path)
    factor = unit_m / cloud.metres_per_unit  # a scene's cloud is in metres already
    scaled = cloud if factor == 1 else replace(cloud, xyz=cloud.xyz * factor)
    return Model(path, scaled, factor)


def _check_source(prepared: Model, original: Model) -> None:
    points, others = prepared.cloud.to_metres(prepared.cloud.xyz), original.cloud.xyz
    low, high = bounds(others)
    if share_beyond(points, others, _SAME * float((high - low).max())) > MOST_UNLIKE:
        raise InputError(
            f"{prepared.path}: its points are not those of {original.path}: name the cloud that it "
            "was prepared from, or prepare it again (--metres-per-unit)"
        )


def check_place(decoded: Floats, original: Floats, fault: str) -> None:
    """Raise InputError if decoded points lie elsewhere than the original points.

    Parameters
    ----------
    decoded, original
        Points (m, 3) and (n, 3), in the same coordinates. Their bounding boxes must be about the
        same.
    fault
        Beginning of the error message.
    """
    apart = _share_outside(decoded, original, _MARGIN), _share_outside(original, decoded, _MARGIN)
    if max(apart) > MOST_UNLIKE or _share_outside(decoded, original, _FAR):
        raise InputError(f"{fault}: the decoded points lie elsewhere")


def _share_outside(points: Floats, others: Floats, margin: float) -> float:
    low, high = bounds(others)
    wider = margin * float((high - low).max())
    return float(np.mean(((points < low - wider) | (points > high + wider)).any(axis=1)))
