from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from pointkit.lidar.sensors import load_sensor
from pointkit.seeding import generator
from virtual_lidar.errors import Draws, ErrorModel, Hits
from virtual_lidar.errors.calibrated import Calibrated
from virtual_lidar.residual_table import REAL

if TYPE_CHECKING:
    import pandas as pd

COMPARED = ("hdl64e", "vlp16", "vlp16_divergence", "vlp16_measured")
"""Compared models; the thesis chose `vlp16_divergence` (section 5.5.3)."""
WALL_KEYS = ["capture", "distance_m", "run"]
REPLICATES = 20
_FRAME_RAD = np.radians(15.0)
"""Azimuth range of a frame of the thesis's sweep; error models draw a new bias for each frame."""


def real_walls(tables: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """Join the wall rows of captures' residual tables; ``capture`` is the table's number, from 1.

    Raises InputError if a table has no wall or lacks columns for a calibration.
    """
    import pandas as pd

    from virtual_lidar.calibration.observations import PLACE

    parts = []
    for number, table in enumerate(tables, 1):
        if missing := [name for name in PLACE if name not in table]:
            raise InputError(f"the residual table has no {', '.join(missing)}: measure it again")
        walls = table[(table["model"] == REAL) & (table["surface"] == "wall")]
        if walls.empty:
            raise InputError(f"residual table {number} has no wall of a capture")
        parts.append(walls.assign(model=REAL, surface="wall", capture=number, replicate=0))
    return pd.concat(parts, ignore_index=True)


def compared_residuals(
    walls: pd.DataFrame,
    models: Mapping[str, ErrorModel],
    *,
    replicates: int = REPLICATES,
    seed: int = 0,
) -> pd.DataFrame:
    """Return residuals, from least-squares planes, of `real_walls` and of `replicates` simulations
    of each model on the same rays.

    A `Calibrated` model draws a new device for each capture and replicate.
    """
    import pandas as pd

    replicas = [
        _replica(walls, name, model, replicate, seed)
        for name, model in models.items()
        for replicate in range(replicates)
    ]
    real = walls.assign(residual_m=_from_planes(walls, walls["residual_m"].to_numpy(float)))
    return pd.concat([real, *replicas], ignore_index=True)


def _replica(
    walls: pd.DataFrame, name: str, model: ErrorModel, replicate: int, seed: int
) -> pd.DataFrame:
    errors = np.empty(len(walls))
    for number, rows in enumerate(_rows_of_walls(walls)):
        wall = walls.iloc[rows]
        rng = generator(seed, "compared", name, f"wall {number}", f"replicate {replicate}")
        device = _device(model, replicate, int(wall["capture"].iloc[0]))
        errors[rows] = _range_errors(wall, device, rng)
    residuals = -errors * np.cos(walls["incidence_rad"].to_numpy(dtype=np.float64))
    return walls.assign(model=name, replicate=replicate, residual_m=_from_planes(walls, residuals))


def _device(model: ErrorModel, replicate: int, capture: int) -> ErrorModel:
    if not isinstance(model, Calibrated):
        return model
    return model.replaced(file=None, device=1 + 1000 * replicate + capture)


def _range_errors(rows: pd.DataFrame, model: ErrorModel, rng: np.random.Generator) -> Floats:
    import pandas as pd

    sensor = load_sensor("vlp16")
    azimuth = np.arctan2(rows["plane_u_m"], rows["distance_m"])
    frames = rows["frame"] * 24 + np.floor(azimuth / _FRAME_RAD)
    frame = np.unique(frames, return_inverse=True)[1]
    laser = rows["laser_id"].to_numpy(dtype=np.int64)
    group = pd.Series(frame * sensor.lasers + laser)
    place = (frame, np.asarray(group.groupby(group).cumcount()), laser)
    shape = (int(frame.max()) + 1, int(place[1].max()) + 1, sensor.lasers)
    distance, angle = np.full(shape, np.inf), np.full(shape, np.nan)
    distance[place] = rows["range_m"]
    angle[place] = rows["incidence_rad"]
    hits = Hits(distance, np.zeros(shape, dtype=np.uint32), angle)
    noisy = model.perturb_ranges(hits, sensor, Draws(rng))
    return np.asarray(noisy[place] - distance[place])


def _rows_of_walls(rows: pd.DataFrame) -> list[NDArray[np.intp]]:
    wall = np.asarray(rows.groupby(WALL_KEYS).ngroup())
    return [np.flatnonzero(wall == number) for number in range(int(wall.max()) + 1)]


def _from_planes(walls: pd.DataFrame, residuals: Floats) -> Floats:
    refitted = residuals.copy()
    places = walls[["plane_u_m", "plane_v_m"]].to_numpy(dtype=np.float64)
    for rows in _rows_of_walls(walls):
        terms = np.column_stack([np.ones(len(rows)), places[rows]])
        coefficients, *_ = np.linalg.lstsq(terms, residuals[rows], rcond=None)
        refitted[rows] -= terms @ coefficients
    return refitted
