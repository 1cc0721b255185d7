"""The clouds from which a stream was coded, named to place decoded points (``decode --like``)."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cloud_files.clouds import SUFFIXES, checked_cloud, read_cloud, read_unchecked_cloud
from cloud_files.content import plain_suffix
from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats, PointCloud, bounds
from puckbench.core.code import CLOUD_FILES
from puckbench.geometry.matching import share_beyond

CODE = (*CLOUD_FILES, "puckbench.geometry.matching")

MOST_UNLIKE = 0.5
"""Largest allowed share of decoded points that match no original point."""
_SAME = 1e-5
"""Largest distance of points that count as equal, as a share of the extent."""
_MARGIN, _FAR = 0.25, 1.0
"""Most points lie within the other cloud's bounding box and the first margin, all within the
second; margins are shares of the box's longest side."""


class Model(NamedTuple):
    """A prepared or an original cloud.

    Parameters
    ----------
    cloud
        A prepared cloud as it is, or an original cloud in metres.
    metres_per_unit
        Factor by which an original's coordinates were multiplied.
    """

    path: Path
    cloud: PointCloud
    metres_per_unit: float = 1.0


def read_models(paths: tuple[Path, ...]) -> tuple[Model | None, Model | None]:
    """Read a prepared cloud and an original, if named, in any order.

    The original's coordinates are multiplied by the ``metres_per_unit`` with which the prepared
    cloud was made of it. Raises InputError if most points of the prepared cloud are not the
    original's.
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


def _original(path: Path, cloud: PointCloud | None, metres_per_unit: float) -> Model:
    if cloud is None:
        read = read_unchecked_cloud(path, keep_missing=True, convert=metres_per_unit == 1)
        cloud = checked_cloud(read, path)
    factor = metres_per_unit / cloud.metres_per_unit  # a scene's cloud is in metres already
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
    """Raise InputError unless decoded (m, 3) and original points (n, 3) have about one extent."""
    apart = _share_outside(decoded, original, _MARGIN), _share_outside(original, decoded, _MARGIN)
    if max(apart) > MOST_UNLIKE or _share_outside(decoded, original, _FAR):
        raise InputError(f"{fault}: the decoded points lie elsewhere")


def _share_outside(points: Floats, others: Floats, margin: float) -> float:
    low, high = bounds(others)
    wider = margin * float((high - low).max())
    return float(np.mean(((points < low - wider) | (points > high + wider)).any(axis=1)))
