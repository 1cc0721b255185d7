from __future__ import annotations

from typing import TYPE_CHECKING

from pointkit.errors import InputError
from puckbench.tables.registry import ATTRIBUTES, TABLES

if TYPE_CHECKING:
    import pandas as pd

BITS = {"reflectance": "bpp_reflectance", "colour": "bpp_colour"}
_MEDIANS = (
    *("bpp", "bpp_geometry", *BITS.values(), "reflectance_psnr", "reflectance_max_error"),
    *("y_psnr", "u_psnr", "v_psnr", "colour_max_error"),
)
_LOSSLESS = ("reflectance_lossless", "colour_lossless")
_KEYS = ["dataset", "codec", "rate"]


@TABLES.register(
    "attribute_bits",
    title="Bits of reflectances and colours",
    needs=(ATTRIBUTES,),
    shown=(
        *("dataset", "codec", "rate", "bpp_geometry"),
        *("bpp_colour", "y_psnr", "bpp_reflectance", "reflectance_psnr"),
    ),
)
def attribute_bits(metrics: pd.DataFrame) -> pd.DataFrame:
    """The table shows bits per point and errors of the attributes, for codecs that code attributes.

    Bits are given for positions and for each attribute. All values are medians over clouds.
    ``..._lossless`` tells whether the values of all clouds are decoded exactly. PSNRs are empty for
    lossless rates; the peak of reflectances is in ``metrics``. Bits of LAZ's intensities are the
    difference to a stream without intensities.
    """
    rows = coded_attributes(metrics)
    groups = rows.groupby(_KEYS, sort=False)
    table = groups[[name for name in _MEDIANS if name in rows]].median()
    for name in _LOSSLESS:
        if name in rows:
            table[name] = rows.dropna(subset=[name]).groupby(_KEYS)[name].all()
    return table.assign(clouds=groups.size()).reset_index()


def coded_attributes(metrics: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of results whose streams contain attributes; raise InputError without any."""
    present = [name for name in BITS.values() if name in metrics]
    rows = metrics.dropna(subset=present, how="all") if present else metrics.head(0)
    if rows.empty:
        raise InputError("metrics table: no codec has coded a reflectance or a colour")
    return rows
