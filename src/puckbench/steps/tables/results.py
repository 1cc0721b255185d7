from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pointkit.errors import InputError
from pointkit.files import read_object
from puckbench.metrics.coordinate_frames import FRAME
from puckbench.metrics.lossless import LOSSLESS, lossless_rows, with_lossless_best, without_lossless
from puckbench.metrics.peaks import PEAK, with_peaks, without_mixed_peaks
from puckbench.metrics.statistics import MIN_SCENES
from puckbench.metrics.table_registry import TABLES
from puckbench.results.curves import read_rows

if TYPE_CHECKING:
    import pandas as pd

CODE = ("puckbench.steps.results_table",)

METRIC_KEYS = ("dataset", "cloud", "codec", "rate")
CLOUD_KEYS = ("dataset", "cloud")
RECOVERY_KEYS = (*METRIC_KEYS, "kind")
DRIVE_KEYS = (*METRIC_KEYS, "times")
_FIRST = (
    *(*RECOVERY_KEYS, "group", "points_in", "points_out", "points", "bytes", "bpp"),
    *("d1_psnr", "d2_psnr", "peak", "lossless"),
    *("encode_s", "encode_s_min", "encode_s_max", "decode_s", "decode_s_min", "decode_s_max"),
    *("encode_peak_mib", "decode_peak_mib"),
    *("true", "found", "matched", "precision", "recall", "label_accuracy"),
)
"""First columns of a table, in this order; further columns follow, sorted by name."""
SPREAD = {"q25": 0.25, "q75": 0.75}
"""Quantiles over clouds in the table ``summary``, by the suffix of their columns."""
_STATISTICS = ("elongation_oriented", "duplicates", "spacing_", "density_", "outliers")
_OF_CLOUDS = ("group", "points", "elongation", "diameter", "scale")
_OF_SPINS = ("sensor", "turns", "seconds", "firings", "noise_bits", "error_model")
_LEFT_OUT = ("dropped_points", "missing_returns")
_COUNTS = {"truth_points_a", "truth_points_b", "true", "found", "matched", *_LEFT_OUT}
_SUMMARY = (
    *("bpp", "cd_point", "cd_plane", "hausdorff_plane", "hausdorff_sq_plane", "d1_rms_m"),
    *("d1_psnr", "d2_psnr", "truth_cd_point", "truth_cd_plane"),
    *("truth_acd_ba_point", "truth_acd_ba_plane", "truth_acd_ab_point", "truth_acd_ab_plane"),
    *("clean_cd_plane", "encode_s", "decode_s"),
)


def table_of(rows: Iterable[dict[str, Any]], keys: Sequence[str]) -> pd.DataFrame:
    """Return rows of results as a table with ordered columns.

    Parameters
    ----------
    rows
        Rows of results: values by name of the column.
    keys
        Names of the columns whose values together identify a row.

    Raises
    ------
    InputError
        There are no rows, or two rows have the same values of `keys`.
    """
    import pandas as pd

    table = pd.DataFrame(list(rows))
    if table.empty:
        raise InputError("no results to put into a table")
    if table.duplicated(list(keys)).any():
        raise InputError(f"two results have the same {', '.join(keys)}")
    for name in _COUNTS & set(table):  # pandas makes floats of integers if values are missing
        table[name] = table[name].astype("Int64")
    first = [name for name in _FIRST if name in table]
    return table[first + sorted(str(name) for name in table if name not in first)]


@TABLES.register("metrics", title="All results", gathered=True)
def metric_rows(files: Sequence[Path]) -> list[dict[str, Any]]:
    """Every measurement, one row per data set, cloud, codec and rate.

    Columns: bytes, bits per point, times in seconds, peak memory in MiB, and metrics in grid units
    (``scale`` units per metre) or, if ``frame`` is metric, in metres. The ``peak`` of D1 and D2
    PSNRs has the metrics' unit; ``lossless`` clouds have no PSNR. Columns ``truth_...`` are
    measured against the true surface, ``clean_...`` against the clean scan of the same rays.
    """
    return read_rows(files)


@TABLES.register("clouds", title="The clouds", gathered=True)
def cloud_rows(files: Sequence[Path]) -> list[dict[str, Any]]:
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
    return [cloud_row(file.parent.name, file) for file in files]


def cloud_row(dataset: str, file: Path) -> dict[str, Any]:
    """Return the row of a cloud in the table ``clouds``, from the cloud's description (JSON)."""
    about = read_object(file)
    if missing := sorted({*_OF_CLOUDS, "name", "size_m"} - about.keys()):
        raise InputError(f"{file}: not the description of a prepared cloud, without {missing[0]}")
    size = dict(zip(("size_x_m", "size_y_m", "size_z_m"), about["size_m"], strict=True))
    kept = {key: about[key] for key in _OF_CLOUDS}
    kept |= {key: value for key, value in about.items() if key.startswith(_STATISTICS)}
    kept |= {key: about[key] for key in ("scene", "digest", *_LEFT_OUT) if key in about}
    if "format" in about:
        kept["source"] = about["source"]
    if about.get("size") == 0:
        kept |= {FRAME: "metric"} | {key: about[key] for key in _OF_SPINS if key in about}
    return {"dataset": dataset, "cloud": about["name"], **kept, **size}


@TABLES.register("left_out", title="What was left out", gathered=True)
def left_out(rows: Sequence[Mapping[str, str]]) -> pd.DataFrame:
    """Files and scenes that could not be used, and why."""
    import pandas as pd

    return pd.DataFrame(rows, columns=["dataset", "scene", "file", "reason"])


@TABLES.register("codecs", title="How codecs are shown", gathered=True)
def codecs(rows: Sequence[Mapping[str, str]]) -> pd.DataFrame:
    """Title, colour, marker and line style of each codec, for figures that are drawn later."""
    import pandas as pd

    return pd.DataFrame(rows, columns=["codec", "title", "colour", "marker", "line"])


PLAN_TABLES = {"left_out": left_out, "codecs": codecs}
"""Tables whose rows are known before the run, with the functions that make them."""


@TABLES.register("scan_errors", title="Errors of the scans themselves", gathered=True)
def scan_error_rows(files: Sequence[Path]) -> list[dict[str, Any]]:
    """Distances of each scan, before coding, to the true surface (``truth_...``) and to the clean
    scan of the same rays (``clean_...``).

    Squared distances are in squared units of the scaled cloud; columns ``..._m`` are in metres.
    """
    kept = (*CLOUD_KEYS, "scene", "group", "scale", FRAME)
    return [
        {key: row[key] for key in row if key in kept or key.startswith(("truth_", "clean_"))}
        for row in map(read_object, files)
    ]


@TABLES.register("recovery", title="Recovery of geometric primitives", gathered=True)
def recovery_rows(files: Sequence[Path]) -> list[dict[str, Any]]:
    """Decoded geometric primitives compared with the scene's labels, for each stream and kind.

    Columns: numbers of labelled (``true``), decoded (``found``) and matched primitives, precision
    and recall, label accuracy of the points, and medians over matched primitives of residuals and
    parameter differences. The kind "all" covers all kinds; a stream without primitives has only an
    empty row of this kind.
    """
    return read_rows(files)


@TABLES.register("drives", title="Tasks on drives", gathered=True)
def drive_rows(files: Sequence[Path]) -> list[dict[str, Any]]:
    """Tasks of a robot on the decoded turns of drives, one row per drive, codec, rate and kind of
    times.

    Columns: bits per point (``bpp``), seconds for all turns, where the times of decoded points come
    from (``times``: ``kept`` by the codec, from the points' ``azimuth``, ``none``), and the values
    and settings of each task. The codec ``undecoded`` means the original drive.
    """
    return read_rows(files)


ROWS = {
    "metrics": (metric_rows, METRIC_KEYS),
    "clouds": (cloud_rows, CLOUD_KEYS),
    "scan_errors": (scan_error_rows, CLOUD_KEYS),
    "recovery": (recovery_rows, RECOVERY_KEYS),
    "drives": (drive_rows, DRIVE_KEYS),
}
"""Tables that join the results of jobs: the function that reads the rows, and the key columns.

The values of the key columns together identify a row.
"""


@TABLES.register("summary", title="Medians per data set, codec and rate")
def summary(metrics: pd.DataFrame) -> pd.DataFrame:
    """Medians over the clouds of each data set, codec and rate, and their spread.

    Columns: medians, quartiles (``_q25``, ``_q75``) if there are six clouds or more, and the number
    of clouds. ``lossless`` is the number of clouds that are decoded with rounding errors only. They
    have no PSNR; for medians, their PSNR counts as the highest. PSNRs have no median if the peaks
    (``peak``) of the clouds differ.
    """
    import pandas as pd

    keys = ["dataset", "codec", "rate"]
    table = with_lossless_best(without_mixed_peaks(with_peaks(metrics)))
    groups = table.groupby(keys, sort=False)
    numbers = [name for name in _SUMMARY if name in metrics]
    shares = [
        groups[numbers].quantile(share).where(groups.size() >= MIN_SCENES).add_suffix(f"_{name}")
        for name, share in SPREAD.items()
    ]
    medians = groups[numbers].median().assign(clouds=groups.size())
    lossless = table.assign(**{LOSSLESS: lossless_rows(metrics)}).groupby(keys, sort=False)
    medians[LOSSLESS] = lossless[LOSSLESS].sum()
    for name in ("weights", PEAK, FRAME):
        if name in table:
            medians[name] = groups[name].first()
    return without_lossless(pd.concat([medians, *shares], axis=1)).reset_index()
