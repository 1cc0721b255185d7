from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass

GRID, SQUARED = "grid units", "grid units²"


@dataclass(frozen=True)
class ColumnLabel:
    """How the report names a column of results.

    Parameters
    ----------
    column
        Name of the column.
    words
        What the column contains, in words.
    unit
        Unit of the values, or empty.
    group
        Heading under which columns of the same kind are listed.
    """

    column: str
    words: str
    unit: str
    group: str

    @property
    def label(self) -> str:
        """Words and unit in one text."""
        return f"{self.words} ({self.unit})" if self.unit else self.words


_CODED, _TRUTH = "Distortion to the coded cloud", "Distortion to the true surface"
_CLEAN = "Distortion to the clean scan"
_COST, _SEEN, _OTHER = "Size, time and memory", "Rendered views and colour", "Other"
_REFLECTANCE = "Reflectance"
GROUPS = (_CODED, _TRUTH, _CLEAN, _COST, _SEEN, _REFLECTANCE, _OTHER)

_COUNTS = (
    *("points_in", "points_a", "points_b", "truth_points_a", "truth_points_b"),
    *("dropped_points", "missing_returns"),
)
DESCRIPTIVE_COLUMNS = frozenset(
    [*_COUNTS, "scale", "diameter", "elongation", "peak", "reflectance_peak"]
)
"""Columns that describe the cloud or the measurement instead of the codec's result."""

_ENDINGS = {
    "_m2": "1/m²",
    "_mm": "mm",
    "_m": "m",
    "_rad": "rad",
    "_deg": "°",
    "_percent": "%",
    "_db": "dB",
    "_s": "s",
}
"""Units of columns without a label, by the ending of the column's name."""
_OF_TABLES = {
    "bd_rate_percent": ("BD-rate", "%"),
    "bd_quality_db": ("BD-PSNR", "dB"),
    "codec": ("Codec", ""),
    "dataset": ("Data set", ""),
    "d1_psnr": ("PSNR D1", "dB"),
    "d2_psnr": ("PSNR D2", "dB"),
    "peak": ("Peak of the PSNRs", ""),
    "reflectance_peak": ("Peak of the PSNR of reflectances", ""),
}
_OF_CLOUDS = {"median": "median", "q25": "25 %", "q75": "75 %"}
_SUFFIXES = {
    "low": "interval from",
    "high": "interval to",
    "half": "half the interval",
    "least": "least of the scenes",
    "most": "greatest of the scenes",
    **_OF_CLOUDS,
}
"""Meanings of the last part of a column's name."""

_WORDS = {
    "point": "point to point",
    "plane": "point to plane",
    "d1": "D1, point to point",
    "d2": "D2, point to plane",
    "ab": "original to decoded",
    "ba": "decoded to original",
    "encode": "Encoding",
    "decode": "Decoding",
    "min": "least",
    "max": "most",
    "geometry": "positions",
    "reflectance": "reflectances",
    "colour": "colours",
    "u": "chroma, U",
    "v": "chroma, V",
    "y": "luma",
}
_KIND, _CALL, _MPEG = "(point|plane)", "(encode|decode)", "(d1|d2)"
_LABELS: tuple[tuple[str, str, str, str | None], ...] = (
    ("bpp", "Bits per point", "bpp", _COST),
    ("bpp_(geometry|reflectance|colour)", "Bits per point of {}", "bpp", _COST),
    ("bytes", "Size of the stream", "bytes", _COST),
    (f"{_CALL}_s", "{} time", "s", _COST),
    (f"{_CALL}_s_(min|max)", "{} time, {} of the repetitions", "s", _COST),
    (f"{_CALL}_ms_per_turn", "{} time of a turn", "ms", _COST),
    (f"{_CALL}_real_time", "{} speed relative to the sensor", "", _COST),
    ("encode_peak_mib", "Memory of encoding", "MiB", _COST),
    ("decode_peak_mib", "Memory of decoding", "MiB", _COST),
    ("points_out", "Points decoded", "", _COST),
    ("mbit_per_s", "Bitrate at the sensor's speed", "Mbit/s", _COST),
    ("range_rms_mm", "Root mean square range error", "mm", _CODED),
    ("range_max_mm", "Largest range error", "mm", _CODED),
    ("returns_lost", "Returns lost", "", _CODED),
    ("returns_added", "Returns added", "", _CODED),
    (f"truth_acd_ba_{_KIND}", "Accuracy, {}: decoded points to the true surface", SQUARED, _TRUTH),
    (f"truth_acd_ab_{_KIND}", "Completeness, {}: true points to the decoded", SQUARED, _TRUTH),
    ("view_psnr", "PSNR of six rendered views", "dB", _SEEN),
    ("view_ssim", "SSIM of six rendered views", "", _SEEN),
    ("([yuv])_psnr", "PSNR of {}", "dB", _SEEN),
    ("colour_max_error", "Largest error of red, green or blue, of 255", "", _SEEN),
    ("colour_lossless", "Whether the colours come back", "", _SEEN),
    ("luminance_l2", "Distance of luminance histograms", "", _SEEN),
    ("joint_quality", "Joint metric of geometry and colour", "", _SEEN),
    ("reflectance_mse", "Mean squared error of reflectances", "", _REFLECTANCE),
    ("reflectance_psnr", "PSNR of reflectances", "dB", _REFLECTANCE),
    ("reflectance_max_error", "Largest error of reflectances", "", _REFLECTANCE),
    ("reflectance_lossless", "Whether the reflectances come back", "", _REFLECTANCE),
    (f"cd_{_KIND}", "Chamfer distance, {}", SQUARED, None),
    (f"acd_(ab|ba)_{_KIND}", "Asymmetric Chamfer distance, {}, {}", SQUARED, None),
    (f"cd_psnr_{_KIND}", "PSNR of the Chamfer distance, {}", "dB", None),
    (f"{_MPEG}_mse", "Mean squared error {}", SQUARED, None),
    (f"{_MPEG}_mm2", "Mean squared error {}", "mm²", None),
    (f"{_MPEG}_psnr", "PSNR {}", "dB", None),
    (f"{_MPEG}_rms_m", "Root mean square error {}", "m", None),
    (f"q99_{_KIND}", "99 % quantile of distances, {}", GRID, None),
    (f"q99_{_KIND}_m", "99 % quantile of distances, {}", "m", None),
    (f"hausdorff_{_KIND}", "Hausdorff distance, {}", GRID, None),
    (f"hausdorff_{_KIND}_m", "Hausdorff distance, {}", "m", None),
    (f"hausdorff_sq_{_KIND}", "Squared Hausdorff distance, {}", SQUARED, None),
)
"""Patterns of column names; words, in which `_WORDS` replace ``{}``; unit; and group of columns.

If the group is None, a prefix in `_REFERENCES` determines the group.
"""
_REFERENCES = {
    "truth_": (_TRUTH, ", to the true surface"),
    "clean_": (_CLEAN, ", to the clean scan"),
    "": (_CODED, ""),
}
"""Group of a column, and words for the reference of its distance, by prefix of the column's name.
"""


_TIME = re.compile(r"(en|de)code_(s|ms_per_turn|real_time)(_\w+)?")


def is_time(column: str) -> bool:
    """Return whether a column contains times of encoding or decoding."""
    return _TIME.fullmatch(column) is not None


def column_label(column: str) -> ColumnLabel:
    """Return how the report names a column; an unknown column has its own name as words."""
    prefix = next(name for name in _REFERENCES if column.startswith(name))
    bare, (group, reference) = column.removeprefix(prefix), _REFERENCES[prefix]
    for pattern, words, unit, group_of_label in _LABELS:
        if match := re.fullmatch(pattern, column if group_of_label else bare):
            text = words.format(*(_WORDS[part] for part in match.groups()))
            if group_of_label:
                return ColumnLabel(column, text, unit, group_of_label)
            return ColumnLabel(column, text + reference, unit, group)
    return ColumnLabel(column, column, "", _OTHER)


def unit_in_frames(unit: str, frames: Collection[str]) -> str:
    """Adapt a unit to the coordinate frames of a table's rows.

    Parameters
    ----------
    unit
        Unit for scaled clouds, which may contain "grid units".
    frames
        Coordinate frames of the rows: ``scaled``, ``metric``, or both.

    Returns
    -------
    str
        The unit with "m" in place of "grid units" for metric clouds; both units for both frames.
    """
    metres = unit.replace("grid units", "m")
    if unit == metres or "metric" not in frames:
        return unit
    return f"{unit} or {metres}" if "scaled" in frames else metres


def table_heading(column: str, others: Collection[str] = ()) -> tuple[str, str]:
    """Return the heading of a column of a table.

    A suffix such as ``_low`` marks a column that contains a statistic of another column.

    Parameters
    ----------
    column
        Name of the column.
    others
        Names of all columns of the table.

    Returns
    -------
    words
        Meaning of the column.
    unit
        Unit of the values, or empty.
    """
    if column in _OF_TABLES:
        return _OF_TABLES[column]
    label = column_label(column)
    if label.words != column:
        return label.words, label.unit
    ending = next((e for e in _ENDINGS if column.endswith(e)), "")
    stem = column.removesuffix(ending)
    base, _, end = stem.rpartition("_")
    if base and end in _SUFFIXES and (end in _OF_CLOUDS or base + ending in others):
        words, unit = table_heading(base + ending)
        return f"{words}, {_SUFFIXES[end]}", unit
    return name_in_words(stem), _ENDINGS.get(ending, "")


def name_in_words(name: str) -> str:
    """Return the name of a column as words: "Codec version" for "codec_version"."""
    words = name.replace("_", " ").strip()
    return words[:1].upper() + words[1:]


def has_label(column: str) -> bool:
    """Return whether the report has words for a column."""
    return column_label(column).group != _OTHER


def ordered_labels(columns: list[str]) -> list[ColumnLabel]:
    """Return labels of columns, ordered by group, without columns that describe the cloud."""
    labels = [column_label(name) for name in columns if name not in DESCRIPTIVE_COLUMNS]
    return sorted(labels, key=lambda item: GROUPS.index(item.group))
