"""A source of published numbers whose curves lie at known distances from those of a run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd

from pointkit.tables import write_table
from puckbench.published_sources.rows import COLUMNS

POINTS, CLOUDS = 8000, 4
"""Points of each cloud, and number of clouds, of the run of `tests.support.reference_lookalike`."""
CONDITIONS = {
    "peak": "1023",
    "points": str(POINTS),
    "frames": str(CLOUDS),
    "resolution": "cube [0, 1023]",
    "machine": "none",
}
"""Conditions of that run."""


def published_rows(codec: str, ratio: float, **changed: Any) -> list[dict[str, str]]:
    """A curve with `ratio` times the mean bits of the run's codec "mine", at the same qualities."""
    conditions = {**CONDITIONS, **changed}
    return [
        {
            **dict.fromkeys(COLUMNS, "none"),
            "dataset": "Things 1",
            "cloud": "mean",
            "codec": codec,
            "codec_version": "v7",
            "rate": f"R{rate}",
            "measure": measure,
            "place": "Table 1",
            "bpp": str(ratio * 0.5 * 2.0**rate * 2.5),
            "value": str(first + 6 * rate),
            **conditions,
        }
        for measure, first in (("d1_psnr", 40.0), ("d2_psnr", 45.0))
        for rate in range(1, 6)
    ]


def write_source(path: Path, *curves: list[dict[str, str]]) -> Path:
    """The CSV file of a source."""
    rows = [row for curve in curves for row in curve]
    write_table(pd.DataFrame(rows, columns=list(COLUMNS)), path)
    return path
