"""The thesis's medians as a source of published numbers (`puckbench compare --published`)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from puckbench.published_sources.registry import SOURCES

if TYPE_CHECKING:
    import pandas as pd

_DATASETS = {
    "objects": ("CAPOD", 180, 500_000),
    "rooms": ("S3DIS", None, 790_000),
    "clean scans": ("S3DIS scanned, clean", None, 1_190_000),
    "noisy scans": ("S3DIS scanned, noisy", None, 1_040_000),
}
"""Published name, number of clouds, and median number of points (Figure 6.4) of data sets."""
_CODECS = {
    "draco": ("Draco", "not stated"),
    "gpcc_as_run": ("G-PCC octree", "TMC13, settings of PCC Arena"),
    "pcgcv1": ("PCGCv1", "authors' repository"),
    "pcgcv2": ("PCGCv2", "authors' repository"),
}
_MEASURES = ("cd_plane", "hausdorff_sq_plane")


@SOURCES.register(
    "jenco2022",
    title="Jenco 2022",
    address="B. Jenco's thesis, Figures 6.4 to 6.6",
    licence="numbers read off figures",
    remark="Medians over clouds, read to about 5 %; bits only at both ends of a curve.",
)
def thesis() -> pd.DataFrame:
    """Medians of the thesis over CAPOD, S3DIS and virtual scans of S3DIS."""
    import pandas as pd

    from jenco2022.published import medians_of_thesis
    from puckbench.published_sources.rows import COLUMNS, MEDIAN, NONE

    rows = []
    for row in medians_of_thesis().to_dict("records"):
        name, clouds, points = _DATASETS[row["dataset"]]
        codec, version = _CODECS[row["codec"]]
        fixed = {
            "dataset": name,
            "cloud": MEDIAN,
            "codec": codec,
            "codec_version": version,
            "rate": row["rate"],
            "bpp": row["bpp"],
            "peak": NONE,
            "points": float(points),
            "frames": float("nan") if clouds is None else float(clouds),
            "resolution": "cube [0, 1023]",
            "anchor": NONE,
            "anchor_version": NONE,
            "machine": NONE,
            "place": "Figures 6.5 and 6.6",
        }
        rows += [{**fixed, "measure": name, "value": float(row[name])} for name in _MEASURES]
    return pd.DataFrame(rows)[list(COLUMNS)]
