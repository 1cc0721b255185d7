from __future__ import annotations

import re
from collections.abc import Callable, Collection
from dataclasses import dataclass

GRID, SQUARED = "grid units", "grid units²"


@dataclass(frozen=True)
class ColumnLabel:
    column: str
    words: str
    unit: str
    group: str

    @property
    def label(self) -> str:
        return f"{self.words} ({self.unit})" if self.unit else self.words


_CODED, _TRUTH = "Distortion to the coded cloud", "Distortion to the true surface"
_CLEAN = "Distortion to the clean scan"
_COST, _SEEN, _OTHER = "Size, time and memory", "Rendered views and colour", "Other"
_REFLECTANCE = "Reflectance"
GROUPS = (_CODED, _TRUTH, _CLEAN, _COST, _SEEN, _REFLECTANCE, _OTHER)

_POINT, _PLANE = "point to point", "point to plane"
_PLAIN = {
    "bpp": ("Bits per point", "bpp", _COST),
    "bpp_geometry": ("Bits per point of positions", "bpp", _COST),
    "bpp_reflectance": ("Bits per point of reflectances", "bpp", _COST),
    "bpp_colour": ("Bits per point of colours", "bpp", _COST),
    "bytes": ("Size of the stream", "bytes", _COST),
    "encode_s": ("Encoding time", "s", _COST),
    "decode_s": ("Decoding time", "s", _COST),
    "encode_peak_mib": ("Memory of encoding", "MiB", _COST),
    "decode_peak_mib": ("Memory of decoding", "MiB", _COST),
    "points_out": ("Points decoded", "", _COST),
    "mbit_per_s": ("Bitrate at the sensor's speed", "Mbit/s", _COST),
    "encode_ms_per_turn": ("Encoding time of a turn", "ms", _COST),
    "decode_ms_per_turn": ("Decoding time of a turn", "ms", _COST),
    "encode_real_time": ("Encoding speed relative to the sensor", "", _COST),
    "decode_real_time": ("Decoding speed relative to the sensor", "", _COST),
    "range_rms_mm": ("Root mean square range error", "mm", _CODED),
    "range_max_mm": ("Largest range error", "mm", _CODED),
    "returns_lost": ("Returns lost", "", _CODED),
    "returns_added": ("Returns added", "", _CODED),
    "truth_acd_ba_point": (
        f"Accuracy, {_POINT}: decoded points to the true surface",
        SQUARED,
        _TRUTH,
    ),
    "truth_acd_ba_plane": (
        f"Accuracy, {_PLANE}: decoded points to the true surface",
        SQUARED,
        _TRUTH,
    ),
    "truth_acd_ab_point": (f"Completeness, {_POINT}: true points to the decoded", SQUARED, _TRUTH),
    "truth_acd_ab_plane": (f"Completeness, {_PLANE}: true points to the decoded", SQUARED, _TRUTH),
    "view_psnr": ("PSNR of six rendered views", "dB", _SEEN),
    "view_ssim": ("SSIM of six rendered views", "", _SEEN),
    "y_psnr": ("PSNR of luma", "dB", _SEEN),
    "u_psnr": ("PSNR of chroma, U", "dB", _SEEN),
    "v_psnr": ("PSNR of chroma, V", "dB", _SEEN),
    "colour_max_error": ("Largest error of red, green or blue, of 255", "", _SEEN),
    "colour_lossless": ("Whether the colours come back", "", _SEEN),
    "reflectance_mse": ("Mean squared error of reflectances", "", _REFLECTANCE),
    "reflectance_psnr": ("PSNR of reflectances", "dB", _REFLECTANCE),
    "reflectance_max_error": ("Largest error of reflectances", "", _REFLECTANCE),
    "reflectance_lossless": ("Whether the reflectances come back", "", _REFLECTANCE),
    "luminance_l2": ("Distance of luminance histograms", "", _SEEN),
    "joint_quality": ("Joint metric of geometry and colour", "", _SEEN),
}
_COUNTS = (
    *("points_in", "points_a", "points_b", "truth_points_a", "truth_points_b"),
    *("dropped_points", "missing_returns"),
)
DESCRIPTIVE_COLUMNS = frozenset(
    [*_COUNTS, "scale", "diameter", "elongation", "peak", "reflectance_peak"]
)
"""Columns that describe the cloud or the measurement, not the codec's result."""

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
"""Unit by ending of a column without a label."""
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
_OF_CLOUDS = {"median": "median", "q05": "5 %", "q25": "25 %", "q75": "75 %", "q95": "95 %"}
_SUFFIXES = {
    "low": "interval from",
    "high": "interval to",
    "half": "half the interval",
    "arithmetic": "arithmetic mean",
    "least": "least of the clouds",
    "most": "greatest of the clouds",
    **_OF_CLOUDS,
}
"""Meaning of the last part of a column's name."""

_DISTANCES = {"point": _POINT, "plane": _PLANE}
_MPEG = {"d1": "D1, point to point", "d2": "D2, point to plane"}
_WAYS = {"ab": "original to decoded", "ba": "decoded to original"}
_TIMES = {"encode": "Encoding time", "decode": "Decoding time"}
_ENDS = {"min": "least", "max": "most"}
_Match = re.Match[str]
_PATTERNS: tuple[tuple[str, Callable[[_Match], tuple[str, str]]], ...] = (
    (r"cd_(point|plane)", lambda m: (f"Chamfer distance, {_DISTANCES[m[1]]}", SQUARED)),
    (
        r"acd_(ab|ba)_(point|plane)",
        lambda m: (f"Asymmetric Chamfer distance, {_WAYS[m[1]]}, {_DISTANCES[m[2]]}", SQUARED),
    ),
    (
        r"cd_psnr_(point|plane)",
        lambda m: (f"PSNR of the Chamfer distance, {_DISTANCES[m[1]]}", "dB"),
    ),
    (
        r"(encode|decode)_s_(min|max)",
        lambda m: (f"{_TIMES[m[1]]}, {_ENDS[m[2]]} of the repetitions", "s"),
    ),
    (r"(d1|d2)_mse", lambda m: (f"Mean squared error {_MPEG[m[1]]}", SQUARED)),
    (r"(d1|d2)_mm2", lambda m: (f"Mean squared error {_MPEG[m[1]]}", "mm²")),
    (r"(d1|d2)_psnr", lambda m: (f"PSNR {_MPEG[m[1]]}", "dB")),
    (r"(d1|d2)_rms_m", lambda m: (f"Root mean square error {_MPEG[m[1]]}", "m")),
    (r"hausdorff_(point|plane)", lambda m: (f"Hausdorff distance, {_DISTANCES[m[1]]}", GRID)),
    (r"hausdorff_(point|plane)_m", lambda m: (f"Hausdorff distance, {_DISTANCES[m[1]]}", "m")),
    (
        r"hausdorff_sq_(point|plane)",
        lambda m: (f"Squared Hausdorff distance, {_DISTANCES[m[1]]}", SQUARED),
    ),
)


_REFERENCES = {
    "truth_": (_TRUTH, ", to the true surface"),
    "clean_": (_CLEAN, ", to the clean scan"),
    "": (_CODED, ""),
}
"""Prefix of a column -> group, and reference of the distance."""


_TIME = re.compile(r"(en|de)code_(s|ms_per_turn|real_time)(_\w+)?")


def is_time(column: str) -> bool:
    """Whether a column depends on a codec's times."""
    return _TIME.fullmatch(column) is not None


def column_label(column: str) -> ColumnLabel:
    if column in _PLAIN:
        return ColumnLabel(column, *_PLAIN[column])
    prefix = next((name for name in _REFERENCES if column.startswith(name)), "")
    bare, (group, reference) = column.removeprefix(prefix), _REFERENCES[prefix]
    for pattern, words in _PATTERNS:
        if match := re.fullmatch(pattern, bare):
            text, unit = words(match)
            return ColumnLabel(column, text + reference, unit, _COST if unit == "s" else group)
    return ColumnLabel(column, column, "", _OTHER)


def unit_in_frames(unit: str, frames: Collection[str]) -> str:
    metres = unit.replace("grid units", "m")
    if unit == metres or "metric" not in frames:
        return unit
    return f"{unit} or {metres}" if "scaled" in frames else metres


def table_heading(column: str, others: Collection[str] = ()) -> tuple[str, str]:
    """Return words and unit for a column in a table's heading.

    A suffix such as ``_low`` marks a statistic of one of the table's columns `others`.
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
    """Return a column name as words: "Codec version" for "codec_version"."""
    words = name.replace("_", " ").strip()
    return words[:1].upper() + words[1:]


def has_label(column: str) -> bool:
    return column_label(column).group != _OTHER


def ordered_labels(columns: list[str]) -> list[ColumnLabel]:
    """Return labels of columns sorted by group, without `DESCRIPTIVE_COLUMNS`."""
    labels = [column_label(name) for name in columns if name not in DESCRIPTIVE_COLUMNS]
    return sorted(labels, key=lambda item: GROUPS.index(item.group))
