"""A run's files that look like real ones, for the tests of the report."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from PIL import Image

from cloud_files.clouds import write_cloud
from pointkit.geometry.cloud import PointCloud
from pointkit.tables import write_table
from puckbench.report.contents import Contents, Example
from puckbench.tables.rate_deltas import bd_rate, bd_rate_pairs
from puckbench.tables.summary import summary
from puckbench.tables.uses import uses
from tests.support.figures_lookalike import (
    clouds_table,
    metrics_table,
    room_cloud,
    scan_errors_table,
)

STEPS = {"draco": {"r1": 32.0, "r8": 1.0}, "gpcc": {"r1": 16.0, "r8": 2.0}}
"""Codec -> rate -> the grid that its decoded points lie on."""
NASTY = "<script>alert('x')</script>&\"name\""
"""A title that would do harm in a page that does not escape."""


def look_alike(folder: Path, points: int = 30_000) -> Contents:
    """Tables, figures and clouds of a run in `folder`, and what its report is made from."""
    return Contents(
        metrics=str(_metrics(folder)),
        tables=_tables(folder),
        figures=_figures(folder),
        examples=(
            _example(folder, "raw", "s3dis_raw", 0.0, points),
            _example(folder, "noisy", "s3dis_noisy", 0.02, points),
        ),
        configuration=_configuration(),
        style=({"dataset_titles": {"s3dis_raw": NASTY}},),
    )


def _metrics(folder: Path) -> Path:
    path = folder / "tables" / "metrics.parquet"
    table = metrics_table().assign(codec_version="DracoPy 2.2.0", puckbench_version="0.1.0")
    table = table.assign(
        d1_psnr=60 - 10 * np.log10(table["cd_plane"]),
        d1_rms_m=_metres(table["cd_plane"]),
        truth_d2_rms_m=_metres(table["truth_cd_plane"]),
        hausdorff_point_m=_metres(table["hausdorff_sq_plane"]),
        points_in=100_000,
    )
    write_table(table, path)
    return path


def _metres(squared: pd.Series[float]) -> pd.Series[float]:
    """Lengths at 100 grid units per metre."""
    return np.sqrt(squared) / 100


def _tables(folder: Path) -> dict[str, str]:
    metrics = pd.read_parquet(folder / "tables" / "metrics.parquet")
    scan_errors = scan_errors_table()
    scan_errors["truth_d2_rms_m"] = _metres(scan_errors["truth_cd_plane"])
    made = {
        "summary": summary(metrics),
        "uses": uses(metrics, scan_errors),
        "bd_rate": bd_rate(metrics, "draco", ["d1_psnr"]),
        "bd_rate_pairs": bd_rate_pairs(metrics, "draco", ["d1_psnr"]),
        "clouds": clouds_table(),
        "scan_errors": scan_errors,
        "claims": _claims(),
    }
    for name, table in made.items():
        write_table(table, folder / "tables" / f"{name}.csv")
    return {name: str(folder / "tables" / f"{name}.csv") for name in made}


def _claims() -> pd.DataFrame:
    """One claim of each verdict."""
    first = {
        "section": "6.2",
        "claim": "CD improves with the rate for all codecs.",
        "verdict": "holds in part; tested on others",
        "here": "Draco improves: yes (CD falls 2 times; 3 at most); G-PCC improves: no (0.9)",
        "thesis": "CD falls 3 times",
        "figure": "fig_6_5, fig_6_6",
    }
    verdicts = (first["verdict"], "holds", "does not hold", "not tested: needs rooms")
    rows = [{"number": n, **first, "verdict": v} for n, v in enumerate(verdicts, 1)]
    return pd.DataFrame(rows)


def _figures(folder: Path) -> dict[str, str]:
    path = folder / "figures" / "fig_6_6.png"
    path.parent.mkdir()
    across = np.linspace(0, 255, 2000).astype(np.uint8)
    Image.fromarray(np.tile(across, (500, 1))).save(path)
    return {"fig_6_6": str(path)}


def _example(folder: Path, kind: str, dataset: str, noise_m: float, points: int) -> Example:
    original = room_cloud(points, noise_m)
    file = folder / "clouds" / dataset / "room.ply"
    write_cloud(file, original)
    decoded = {
        codec: {rate: _decoded(folder, original, dataset, codec, rate) for rate in rates}
        for codec, rates in STEPS.items()
    }
    return Example(kind=kind, dataset=dataset, cloud="cloud_0", original=str(file), decoded=decoded)


def _decoded(folder: Path, original: PointCloud, dataset: str, codec: str, rate: str) -> str:
    step = STEPS[codec][rate]
    points = np.unique(np.round(original.xyz / step) * step, axis=0)
    file = folder / "decoded" / dataset / codec / f"{rate}.ply"
    write_cloud(file, PointCloud(points))
    return str(file)


def _configuration() -> dict[str, object]:
    datasets = {
        name: {"scene_set": "rooms", "make": "scan", "errors": "vlp16"}
        for name in ("capod", "s3dis_raw", "s3dis_clean", "s3dis_noisy")
    }
    return {
        "scene_sets": {"rooms": {"loader": "embedded_rooms"}},
        "datasets": datasets,
        "codecs": {"draco": {}, "gpcc": {"options": {"profile": NASTY}}},
    }
