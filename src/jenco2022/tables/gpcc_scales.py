from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from pointkit.errors import InputError
from puckbench.tables.registry import TABLES

if TYPE_CHECKING:
    import pandas as pd

CODE = ("jenco2022.*", "virtual_lidar.residual_table", "virtual_lidar.sweep")

REFERENCE, AS_RUN = "gpcc", "gpcc_as_run"
QUANTILES = {"q25": 0.25, "median": 0.5, "q75": 0.75}
_MEASURED = ("bpp", "cd_point", "cd_plane", "d1_psnr")
_COMPARED = {"bits": "bpp", "distortion": "cd_point"}


_COLUMNS = {"role": "Role", "dyadic": "Dyadic", "distortion": "Distortion"}


@TABLES.register("gpcc_scales", title="G-PCC by scale", needs=("gpcc_scales",), columns=_COLUMNS)
def gpcc_scales(
    metrics: pd.DataFrame, *, codecs: Mapping[str, str], scales: Mapping[str, Mapping[str, float]]
) -> pd.DataFrame:
    """Rate and distortion of G-PCC at each scale of its grid: medians over clouds, and ratios.

    Ratios of bits and of Chamfer distances (point-to-point), with quartiles over clouds, are
    relative to the codec with rounded coordinates and the tools of the common test conditions, at
    the same scale.

    Parameters
    ----------
    metrics
        Results of the run.
    codecs
        Names of the codecs with the roles `REFERENCE` and `AS_RUN` (truncated coordinates, default
        tools), by role.
    scales
        Scale of the grid by codec and rate.

    Raises
    ------
    InputError
        No result has a scale.
    """
    rows = _with_scales(metrics, codecs, scales)
    keys = ["dataset", "cloud", "scale"]
    reference = rows[rows["role"] == REFERENCE].drop_duplicates(keys)
    rows = rows.merge(
        reference[[*keys, *_COMPARED.values()]], on=keys, how="left", suffixes=("", "_reference")
    )
    for name, column in _COMPARED.items():
        rows[name] = rows[column] / rows[f"{column}_reference"]
    groups = rows.groupby(["dataset", "codec", "role", "rate", "scale"], sort=False)
    table = groups[list(_MEASURED)].median().assign(clouds=groups["cloud"].nunique())
    for name in _COMPARED:
        for suffix, level in QUANTILES.items():
            table[f"{name}_{suffix}"] = groups[name].quantile(level)
    table = table.reset_index()
    table.insert(5, "dyadic", [_dyadic(scale) for scale in table["scale"]])
    return table.sort_values(["dataset", "codec", "scale"], ignore_index=True)


def _with_scales(
    metrics: pd.DataFrame, codecs: Mapping[str, str], scales: Mapping[str, Mapping[str, float]]
) -> pd.DataFrame:
    role_of = {codec: role for role, codec in codecs.items()}
    columns = ["dataset", "cloud", "codec", "rate", *_MEASURED]
    if missing := [name for name in columns if name not in metrics]:
        raise InputError(f"metrics table: no column {missing[0]!r}")
    rows = metrics[columns][metrics["codec"].isin(scales)]
    if rows.empty:
        raise InputError(f"metrics table: no results of {', '.join(scales) or 'a G-PCC codec'}")
    pairs = zip(rows["codec"], rows["rate"], strict=True)
    factors = [float(scales[codec].get(rate, np.nan)) for codec, rate in pairs]
    roles = rows["codec"].map(lambda codec: role_of.get(codec, "other"))
    return rows.assign(scale=factors, role=roles).dropna(subset=["scale"])


def _dyadic(scale: float) -> bool:
    return bool(np.log2(scale).is_integer())
