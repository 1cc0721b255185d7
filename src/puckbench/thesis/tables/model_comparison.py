"""Real wall residuals against error models: the models on the real rays, and how far they are off.

A model is drawn on the very rays that a capture has, and a plane is fitted to what comes out as to
what was measured. So geometry and fit are the same, and what differs is the noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from puckbench.core.errors import InputError
from puckbench.core.seeding import generator
from puckbench.geometry.cloud import Floats
from puckbench.lidar import load_sensor, open_error_model
from puckbench.lidar.errors import Draws, ErrorModel, Hits
from puckbench.lidar.errors.calibrated import Calibrated
from puckbench.lidar.residual_table import REAL
from puckbench.metrics.table_registry import SENSOR, TABLES
from puckbench.thesis.figures.model_styles import ordered_models

if TYPE_CHECKING:
    import pandas as pd

    from puckbench.lidar.calibration import Settings

COMPARED = ("hdl64e", "vlp16", "vlp16_divergence", "vlp16_measured")
"""The models that the verdict is about, the thesis's choice (section 5.5.3) among them."""

REPLICATES, RESAMPLES = 20, 300
# Frames of the thesis's sweep, in which a bias is drawn once: 15 degrees of azimuth.
_FRAME_RAD = np.radians(15.0)
_BIN_M, _REACH_M = 2e-4, 0.5
_WALL = ["capture", "distance_m", "run"]


def real_walls(tables: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """The walls of captures in one table, with a column ``capture`` from 1.

    Raises
    ------
    InputError
        A table has no wall of a capture, or lacks columns that a calibration needs.
    """
    import pandas as pd

    from puckbench.lidar.calibration.observations import PLACE

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
    """The walls of `real_walls` and, for each model and replicate, what it makes of the same rays.

    A model that can draw other devices (`Calibrated`) draws one for each capture and replicate. The
    columns are those of `walls`; the residuals are to planes fitted by least squares.
    """
    import pandas as pd

    drawn = [
        _drawn(walls, name, model, replicate, seed)
        for name, model in models.items()
        for replicate in range(replicates)
    ]
    real = walls.assign(residual_m=_off_planes(walls, walls["residual_m"].to_numpy(float)))
    return pd.concat([real, *drawn], ignore_index=True)


def default_models() -> dict[str, ErrorModel]:
    """The models of `COMPARED` with their own parameters."""
    return {name: open_error_model(name) for name in COMPARED}


@TABLES.register(
    "model_distances", title="How far error models are from real walls", category=SENSOR
)
def model_distances(
    compared: pd.DataFrame, *, resamples: int = RESAMPLES, seed: int = 0
) -> pd.DataFrame:
    """Earth mover's distance of each error model's wall residuals to those of real sensors.

    In metres, with the ends of its 95 % interval; ``chance_m`` is what the distance of a sensor
    that follows the model exceeds in 5 % of cases. The numbers of the figure `model_verdict`.

    Parameters
    ----------
    compared
        As `compared_residuals` makes it.
    resamples
        Draws, with replacement, of wall and laser together (residuals of one laser on one wall
        share a bias), of which the interval is the 2.5 and 97.5 % quantiles.
    seed
        Of the draws.

    Returns
    -------
    pd.DataFrame
        One row per model, the real sensor's (distance 0) first: ``model``, ``residuals``,
        ``std_m``, ``emd_m``, ``emd_low_m``, ``emd_high_m`` and ``chance_m``, which the distance of
        one replicate to all of them exceeds in 5 % of replicates.

    Raises
    ------
    InputError
        There are no real residuals.
    """
    import pandas as pd

    if not (compared["model"] == REAL).any():
        raise InputError("the comparison has no real residuals")
    real = _Blocks.of(compared[compared["model"] == REAL])
    rows = []
    for name in ordered_models(compared["model"].astype(str)):
        of_model = compared[compared["model"] == name]
        one = _Blocks.of(of_model)
        draws = generator(seed, "model distances", name)
        pairs = [(real.drawn(draws), one.drawn(draws)) for _ in range(resamples)]
        resampled = [_emd(a, b) for a, b in pairs]
        low, high = np.quantile(resampled, [0.025, 0.975])
        rows.append(
            {
                "model": name,
                "residuals": len(of_model),
                "std_m": float(of_model["residual_m"].std()),
                "emd_m": _emd(real.total, one.total),
                "emd_low_m": float(low) if name != REAL else 0.0,
                "emd_high_m": float(high) if name != REAL else 0.0,
                "chance_m": _chance(of_model, one.total),
            }
        )
    return pd.DataFrame(rows)


def left_out(
    tables: Sequence[pd.DataFrame],
    *,
    settings: Settings | None = None,
    replicates: int = REPLICATES,
    resamples: int = RESAMPLES,
    seed: int = 0,
) -> pd.DataFrame:
    """Compare each capture with a model that was calibrated on the other captures.

    Columns as `model_distances`, after ``capture``, the one left out; the model that was calibrated
    on the others is ``calibrated``, beside those of `COMPARED`.
    """
    import pandas as pd

    from puckbench.lidar.calibration import Settings

    settings = settings or Settings("spot", quantum_m=0.002)
    found = []
    for number, table in enumerate(tables, 1):
        others = [one for other, one in enumerate(tables, 1) if other != number]
        if not others:
            raise InputError("to leave a device out takes captures of two devices")
        models = {**default_models(), "calibrated": _model_of(others, settings)}
        compared = compared_residuals(real_walls([table]), models, replicates=replicates, seed=seed)
        distances = model_distances(compared, resamples=resamples, seed=seed)
        distances.insert(0, "capture", number)
        found.append(distances)
    return pd.concat(found, ignore_index=True)


def verdict(distances: pd.DataFrame, chosen: str = "vlp16_divergence") -> str:
    """What `model_distances` says of the model that the thesis chose, in two sentences."""
    rows = {str(row["model"]): row for row in distances.to_dict("records")}
    nearest = min((name for name in rows if name != REAL), key=lambda name: rows[name]["emd_m"])
    one = rows[chosen]
    said = "more" if one["emd_m"] > one["chance_m"] else "no more"
    return (
        f"The thesis's {chosen} spreads wall residuals by {_mm(one['std_m'])} where real sensors"
        f" have {_mm(rows[REAL]['std_m'])}, an earth mover's distance of {_off(one)}, {said} than"
        f" chance allows ({_mm(one['chance_m'])}). Nearest is {nearest} with {_off(rows[nearest])}."
    )


def _off(row: Mapping[Any, Any]) -> str:
    return f"{_mm(row['emd_m'])} ({_mm(row['emd_low_m'])} to {_mm(row['emd_high_m'])})"


def _mm(metres: float) -> str:
    return f"{1000 * metres:.1f} mm"


def _model_of(tables: Sequence[pd.DataFrame], settings: Settings) -> Calibrated:
    """New devices of the kind that the tables were measured on."""
    from puckbench.lidar.calibration import calibrate, model_file

    parameters = dict(model_file(calibrate(tables, settings), [])["parameters"])
    parameters.pop("bias_m", None)
    parameters["ranges_m"] = tuple(parameters["ranges_m"])
    return Calibrated(**parameters)


def _drawn(
    walls: pd.DataFrame, name: str, model: ErrorModel, replicate: int, seed: int
) -> pd.DataFrame:
    """The walls with a model's range errors in place of the real ones."""
    errors = np.empty(len(walls))
    for number, rows in enumerate(_walls_of(walls)):
        wall = walls.iloc[rows]
        rng = generator(seed, "compared", name, f"wall {number}", f"replicate {replicate}")
        device = _device(model, replicate, int(wall["capture"].iloc[0]))
        errors[rows] = _errors(wall, device, rng)
    towards = -errors * np.cos(walls["incidence_rad"].to_numpy(dtype=np.float64))
    return walls.assign(model=name, replicate=replicate, residual_m=_off_planes(walls, towards))


def _device(model: ErrorModel, replicate: int, capture: int) -> ErrorModel:
    """The model with a device of its own for each capture and replicate, where it has devices."""
    if not isinstance(model, Calibrated):
        return model
    return model.replaced(file=None, device=1 + 1000 * replicate + capture)


def _errors(rows: pd.DataFrame, model: ErrorModel, rng: np.random.Generator) -> Floats:
    """A model's range errors on the rays of one wall, m, (n,)."""
    import pandas as pd

    sensor = load_sensor("vlp16")
    azimuth = np.arctan2(rows["plane_u_m"], rows["distance_m"])
    frame = _codes(rows["frame"] * 24 + np.floor(azimuth / _FRAME_RAD))
    laser = rows["laser_id"].to_numpy(dtype=np.int64)
    step = pd.Series(frame * sensor.lasers + laser)
    place = (frame, np.asarray(step.groupby(step).cumcount()), laser)
    shape = (int(frame.max()) + 1, int(place[1].max()) + 1, sensor.lasers)
    distance, angle = np.full(shape, np.inf), np.full(shape, np.nan)
    distance[place] = rows["range_m"]
    angle[place] = rows["incidence_rad"]
    hits = Hits(distance, np.zeros(shape, dtype=np.uint32), angle)
    noisy = model.perturb_ranges(hits, sensor, Draws(rng))
    return np.asarray(noisy[place] - distance[place])


def _codes(values: pd.Series[float]) -> NDArray[np.intp]:
    """The rank of each value among those there are, from 0."""
    return np.unique(values, return_inverse=True)[1]


def _walls_of(rows: pd.DataFrame) -> list[NDArray[np.intp]]:
    """The rows of each wall."""
    wall = np.asarray(rows.groupby(_WALL).ngroup())
    return [np.flatnonzero(wall == number) for number in range(int(wall.max()) + 1)]


def _off_planes(walls: pd.DataFrame, residual: Floats) -> Floats:
    """`residual` (n,) less the plane of each wall that fits it best."""
    rest = residual.copy()
    places = walls[["plane_u_m", "plane_v_m"]].to_numpy(dtype=np.float64)
    for rows in _walls_of(walls):
        terms = np.column_stack([np.ones(len(rows)), places[rows]])
        fitted, *_ = np.linalg.lstsq(terms, residual[rows], rcond=None)
        rest[rows] -= terms @ fitted
    return rest


class _Blocks:
    """Histograms of residuals, one per wall and laser: what is drawn again as a whole."""

    def __init__(self, counts: Floats) -> None:
        self.counts = counts
        self.total = counts.sum(axis=0)

    @classmethod
    def of(cls, rows: pd.DataFrame) -> _Blocks:
        """Blocks of the rows of one model."""
        block = np.asarray(rows.groupby(["replicate", *_WALL, "laser_id"]).ngroup())
        bins = _bins(rows["residual_m"].to_numpy(dtype=np.float64))
        size = (int(block.max()) + 1, _BINS)
        counts = np.bincount(block * _BINS + bins, minlength=size[0] * size[1])
        return cls(counts.reshape(size).astype(np.float64))

    def drawn(self, rng: np.random.Generator) -> Floats:
        """The sum of as many blocks drawn with replacement."""
        blocks = len(self.counts)
        weights = np.bincount(rng.integers(blocks, size=blocks), minlength=blocks)
        return np.asarray(weights @ self.counts)


_BINS = round(2 * _REACH_M / _BIN_M)


def _bins(residuals: Floats) -> NDArray[np.int64]:
    numbers = np.floor((residuals + _REACH_M) / _BIN_M).astype(np.int64)
    return np.clip(numbers, 0, _BINS - 1)


def _emd(one: Floats, other: Floats) -> float:
    """Area between the distribution functions of two histograms, m."""
    apart = np.cumsum(one) / one.sum() - np.cumsum(other) / other.sum()
    return float(np.abs(apart).sum() * _BIN_M)


def _chance(rows: pd.DataFrame, total: Floats) -> float:
    """What 5 % of a model's replicates are farther than from all of them, m; nan for one."""
    residuals = rows["residual_m"].to_numpy(dtype=np.float64)
    parts = rows.groupby("replicate").indices.values()
    if len(parts) < 2:
        return float("nan")
    each = [np.bincount(_bins(residuals[part]), minlength=_BINS) for part in parts]
    return float(np.quantile([_emd(one.astype(np.float64), total) for one in each], 0.95))
