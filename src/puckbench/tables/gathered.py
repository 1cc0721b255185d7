"""Tables that join the results of many jobs, or whose rows are known before the run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from puckbench.results.columns import Column
from puckbench.results.row_files import read_rows
from puckbench.results.rows import (
    CLOUD_KEYS,
    DRIVE_KEYS,
    METRIC_KEYS,
    RECOVERY_KEYS,
    cloud_row,
    scan_error_row,
    table_of,
)
from puckbench.tables.registry import TABLES

if TYPE_CHECKING:
    import pandas as pd

CODE = ("puckbench.results.rows", "puckbench.results.row_files")


@TABLES.register(
    "metrics",
    title="All results",
    gathered=True,
    shown=("dataset", "cloud", "codec", "rate", "bpp", "d1_psnr", "d2_psnr", "d1_rms_m"),
)
def metrics(files: Sequence[Path]) -> pd.DataFrame:
    """Every measurement, one row per data set, cloud, codec and rate.

    Columns: bytes, bits per point, times in seconds, peak memory in MiB, and metrics in grid units
    (``scale`` units per metre) or, if ``frame`` is metric, in metres. The ``peak`` of D1 and D2
    PSNRs has the metrics' unit; ``lossless`` clouds have no PSNR. Columns ``truth_...`` are
    measured against the true surface, ``clean_...`` against the clean scan of the same rays.
    """
    return table_of(read_rows(files), METRIC_KEYS)


@TABLES.register("clouds", title="The clouds", gathered=True)
def clouds(files: Sequence[Path]) -> pd.DataFrame:
    """The clouds, one row each.

    Columns: number of points, extent in metres along x, y and z, elongation (shortest side of the
    bounding box divided by the longest; ``elongation_oriented``: of the oriented box), diameter
    (largest distance of two points, in grid units), scale (grid units per metre), share of
    duplicates, distance to the nearest point (m), points per square metre (median, 5 and 95 %),
    share of outliers, digest of the coordinates, points left out (``dropped_points``), missing
    returns among these, and the user's file (``source``). For clouds in metres with a sensor's
    returns: number and duration (s) of turns, and the entropy (bits) of the noise in steps of the
    sensor's ranges.
    """
    return table_of([cloud_row(file.parent.name, file) for file in files], CLOUD_KEYS)


@TABLES.register("scan_errors", title="Errors of the scans themselves", gathered=True)
def scan_errors(files: Sequence[Path]) -> pd.DataFrame:
    """Distances of each scan, before coding, to the true surface (``truth_...``) and to the clean
    scan of the same rays (``clean_...``).

    Squared distances are in squared units of the scaled cloud; columns ``..._m`` are in metres.
    """
    return table_of(map(scan_error_row, files), CLOUD_KEYS)


@TABLES.register("recovery", title="Recovery of geometric primitives", gathered=True)
def recovery(files: Sequence[Path]) -> pd.DataFrame:
    """Decoded geometric primitives compared with the scene's labels, for each stream and kind.

    Columns: numbers of labelled (``true``), decoded (``found``) and matched primitives, precision
    and recall, label accuracy of the points, and medians over matched primitives of residuals and
    parameter differences. The kind "all" covers all kinds; a stream without primitives has only an
    empty row of this kind.
    """
    return table_of(read_rows(files), RECOVERY_KEYS)


@TABLES.register("drives", title="Tasks on drives", gathered=True)
def drives(files: Sequence[Path]) -> pd.DataFrame:
    """Tasks of a robot on the decoded turns of drives, one row per drive, codec, rate and kind of
    times.

    Columns: bits per point (``bpp``), seconds for all turns, where the times of decoded points come
    from (``times``: ``kept`` by the codec, from the points' ``azimuth``, ``none``), and the values
    and settings of each task. The codec ``undecoded`` means the original drive.
    """
    return table_of(read_rows(files), DRIVE_KEYS)


@TABLES.register(
    "left_out",
    title="What was left out",
    gathered=True,
    columns=[Column("file", "File"), Column("reason", "Reason")],
)
def left_out(rows: Sequence[Mapping[str, str]]) -> pd.DataFrame:
    """Files and scenes that could not be used, and why."""
    import pandas as pd

    return pd.DataFrame(rows, columns=["dataset", "scene", "file", "reason"])


_LOOK = {"title": "Title", "colour": "Colour", "marker": "Marker", "line": "Line"}


@TABLES.register("codecs", title="How codecs are shown", gathered=True, columns=_LOOK)
def codecs(rows: Sequence[Mapping[str, str]]) -> pd.DataFrame:
    """Title, colour, marker and line style of each codec, for figures that are drawn later."""
    import pandas as pd

    return pd.DataFrame(rows, columns=["codec", *_LOOK])
