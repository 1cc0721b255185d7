"""The columns of results: what each contains, its unit, and which values are better.

This is the only description of columns. Tables, figures, the report and the printed summary use it.
The columns that several tables share, and those of rows of results, are declared here, each by its
full name. A plug-in declares the columns that only it makes where it is registered::

    @METRICS.register("centroid", columns={"centroid_m": "Distance between the centroids"})
    @TABLES.register("cheapest", columns=[Column("cheapest_bpp", "Fewest bits", "bpp", LOWER)])

A column that contains a statistic of another column has the name of the other column and a suffix,
such as ``bpp_q25`` beside ``bpp``; if the other name ends in a unit, the suffix stands before the
unit: ``std_half_m`` beside ``std_m``. `column_named` describes such columns by the other column and
`STATISTICS`. Any other column is shown under its own name, with the unit that its name ends in.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal

from pointkit.errors import InputError

FRAME = "frame"
"""Column of tables of clouds and results: "metric" for clouds in metres, empty for scaled
clouds."""
GRID, SQUARED = "grid units", "grid units²"
"""Units of lengths and their squares in scaled clouds; for clouds in metres, these are m and m²."""
HIGHER: Literal["higher"] = "higher"
LOWER: Literal["lower"] = "lower"

CODED, TRUTH = "Distortion to the coded cloud", "Distortion to the true surface"
CLEAN = "Distortion to the clean scan"
COST, SEEN, OTHER = "Size, time and memory", "Rendered views and colour", "Other"
REFLECTANCE = "Reflectance"
PLOTTED = (CODED, TRUTH, CLEAN, COST, SEEN, REFLECTANCE, OTHER)
"""Groups of columns that the report's plot offers, in this order."""
CLOUD, RUN, TASK = "The cloud", "How it was measured", "Tasks of a robot"
"""Groups of columns that the plot does not offer."""

_NO_TRUTH, _NO_SCAN = "the true surface is not known", "the cloud is not a virtual scan"
_NO_RETURNS, _NOT_TIMED = "no returns of a sensor", "not timed"
_NO_ATTRIBUTE = "no such attribute was coded"
_LOSSLESS = "lossless, so that the PSNR is infinite"
_NO_METRES = "the size of the cloud in metres is not known"
NO_COMMON_ERROR = "no two rates enclose the error"
"""Why bits at an equal error may be missing."""
NO_RATE = "no rate reaches the error of the grid"
"""Why bits on a grid may be missing."""
_FEW = "fewer than six clouds or scenes"
_OTHERWISE = "does not apply"


@dataclass(frozen=True)
class Column:
    """A column of tables of results.

    Parameters
    ----------
    name
        Name of the column.
    words
        What the column contains, in words.
    unit
        Unit of the values, or empty.
    better
        Whether higher or lower values are better; None if neither is.
    group
        Heading under which columns of the same kind are listed.
    short
        Short name, on axes of figures and in cells of tables; empty for `words`.
    printed
        Heading in the summary that a run prints, with the unit; empty for `words`.
    digits
        Format of numbers in ranges that the summary prints.
    decimals
        Number of decimals in LaTeX tables, where a value has no interval; None: three significant
        digits.
    missing
        Why a value may be missing; empty for the usual reason (`reason`).
    leads
        Whether the column is among the first of a table. These are in the order of declaration.
    summarised
        Whether a run's summary has the column: as medians over clouds in the table ``summary`` or,
        for a task, among the first of the printed columns.
    counts
        Whether the values stay whole numbers even if some are missing.
    timed
        Whether the values depend on the speed of the machine.
    bookkeeping
        Whether the column tells only how other values were obtained. It then comes last, hidden.
    """

    name: str
    words: str
    unit: str = ""
    better: Literal["higher", "lower"] | None = None
    group: str = OTHER
    short: str = ""
    printed: str = ""
    digits: str = ".2g"
    decimals: int | None = None
    missing: str = ""
    leads: bool = False
    summarised: bool = False
    counts: bool = False
    timed: bool = False
    bookkeeping: bool = False

    @property
    def label(self) -> str:
        """Words and unit in one text."""
        return f"{self.words} ({self.unit})" if self.unit else self.words

    @property
    def short_words(self) -> str:
        """The short name, or the words if there is none."""
        return self.short or self.words

    @property
    def heading(self) -> str:
        """Heading in the summary that a run prints."""
        return self.printed or self.words.lower()

    @property
    def reason(self) -> str:
        """Why a value of the column may be missing."""
        return self.missing or (_NO_METRES if self.unit in ("m", "mm", "mm²") else _OTHERWISE)


Columns = Mapping[str, str] | Iterable[Column]
"""Columns that a plug-in declares: descriptions or, in short, meanings by name of the column."""

STATISTICS = {
    "low": "interval from",
    "high": "interval to",
    "half": "half the interval",
    "least": "least of the scenes",
    "most": "greatest of the scenes",
    "median": "median",
    "q05": "5 %",
    "q25": "25 %",
    "q75": "75 %",
    "q95": "95 %",
}
"""Suffixes of columns that contain a statistic of another column, and their meanings."""
_ALWAYS_STATISTICS = ("median", "q05", "q25", "q75", "q95")
"""Suffixes that mark a statistic even if nothing tells what the column without it contains."""
_OF_SIX = ("low", "high", "q25", "q75")
"""Suffixes of statistics that need six clouds or scenes."""
SPREAD = {"q25": 0.25, "q75": 0.75}
"""Quantiles over clouds that are given beside medians, by suffix."""

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
"""Units of columns that nobody declared, by the ending of the column's name."""

_declared: dict[str, Column] = {}
_waiting: list[Callable[[], object]] = []
"""Functions that import plug-ins which declare columns, until the first is asked for."""


def declare(columns: Columns, group: str = OTHER) -> None:
    """Declare columns of results.

    Parameters
    ----------
    columns
        The columns.
    group
        Group of columns that are described by their meaning only.

    Raises
    ------
    InputError
        A column is declared already, and described differently.
    """
    for each in _described(columns, group):
        if _declared.setdefault(each.name, each) != each:
            raise InputError(f"column '{each.name}' is declared twice, differently: rename it")


def declared_by(import_plugins: Callable[[], object]) -> None:
    """Add a function that imports plug-ins which declare columns; it is called when needed."""
    _waiting.append(import_plugins)


def declared_columns() -> dict[str, Column]:
    """Return all declared columns, by name and in the order of declaration."""
    _is_any_declared()
    return dict(_declared)


def declared_among(names: Iterable[object]) -> list[Column]:
    """Return the declared columns with the given names, in the order of declaration."""
    found = {name for name in map(str, names) if is_declared(name)}
    return [each for name, each in _declared.items() if name in found]


def is_declared(name: str) -> bool:
    """Return whether someone has declared a column with this name."""
    return _is_any_declared(name)


def _is_any_declared(*names: str) -> bool:
    """Return whether a name is declared; plug-ins are imported until one is."""
    while not (is_known := not _declared.keys().isdisjoint(names)) and _waiting:
        _waiting.pop()()
    return is_known


def column_named(name: str, others: Collection[str] = ()) -> Column:
    """Return the description of a column.

    Parameters
    ----------
    name
        Name of the column, which may be a statistic of another one, or one that nobody declared.
    others
        Names of all columns of the table.
    """
    stem, ending = _stem_and_ending(name)
    base, _, suffix = stem.rpartition("_")
    whole = base + ending if base and suffix in STATISTICS else ""
    is_known = _is_any_declared(name, whole)
    if name in _declared:
        return _declared[name]
    if whole and (is_known or whole in others or suffix in _ALWAYS_STATISTICS):
        return _statistic(column_named(whole), name, suffix)
    return _undeclared(name)


def is_spread(name: str, others: Collection[str]) -> bool:
    """Return whether a column contains quartiles of another column of the table."""
    base, _, suffix = name.rpartition("_")
    return suffix in SPREAD and base in others


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
    metres = unit.replace(GRID, "m")
    if unit == metres or "metric" not in frames:
        return unit
    return f"{unit} or {metres}" if "scaled" in frames else metres


def name_in_words(name: str) -> str:
    """Return the name of a column as words: "Codec version" for "codec_version"."""
    words = name.replace("_", " ").strip()
    return words[:1].upper() + words[1:]


def _statistic(of: Column, name: str, suffix: str) -> Column:
    words, missing = f"{of.words}, {STATISTICS[suffix]}", of.missing
    if suffix in _OF_SIX:
        missing = f"{missing}, or {_FEW}" if missing else _FEW
    return replace(of, name=name, words=words, short="", printed="", missing=missing)


def _undeclared(name: str) -> Column:
    if name.endswith("_psnr"):
        return Column(name, name_in_words(name), "dB", HIGHER, missing=_LOSSLESS, decimals=1)
    stem, ending = _stem_and_ending(name)
    return Column(name, name_in_words(stem), _ENDINGS.get(ending, ""))


def _stem_and_ending(name: str) -> tuple[str, str]:
    ending = next((each for each in _ENDINGS if name.endswith(each)), "")
    return name.removesuffix(ending), ending


def _described(columns: Columns, group: str) -> Iterable[Column]:
    if not isinstance(columns, Mapping):
        return columns
    described = columns.items()
    return (replace(_undeclared(name), words=words, group=group) for name, words in described)


# ---- what rows of results are about, and their size


def _keys_and_sizes() -> Iterator[Column]:
    for name in ("dataset", "cloud", "codec", "rate", "kind"):
        yield Column(name, "Data set" if name == "dataset" else name.capitalize(), leads=True)
    yield Column("group", "Group", leads=True, bookkeeping=True)
    yield Column("points_in", "Points in", group=CLOUD, leads=True)
    yield Column("points_out", "Points decoded", group=COST, leads=True)
    yield Column("points", "Points", leads=True)
    size = partial(Column, better=LOWER, group=COST)
    yield size("bytes", "Size of the stream", "bytes", leads=True)
    yield size("bpp", "Bits per point", "bpp", leads=True, summarised=True)
    for part, words in (
        ("geometry", "positions"),
        ("reflectance", "reflectances"),
        ("colour", "colours"),
    ):
        yield size(f"bpp_{part}", f"Bits per point of {words}", "bpp", missing=_NO_ATTRIBUTE)


# ---- distances of clouds

_POINT, _PLANE = "point to point", "point to plane"
_KINDS = {"point": _POINT, "plane": _PLANE}
_MPEG = {"d1": f"D1, {_POINT}", "d2": f"D2, {_PLANE}"}
_WAYS = {"ba": "decoded to original", "ab": "original to decoded"}
_WAYS_TO_TRUTH = {
    "ba": "Accuracy, {}: decoded points to the true surface",
    "ab": "Completeness, {}: true points to the decoded",
}
_IN_SUMMARY = (
    *("cd_point", "cd_plane", "hausdorff_plane", "hausdorff_sq_plane", "d1_rms_m"),
    *("truth_cd_point", "truth_cd_plane", "clean_cd_plane"),
    *(f"truth_acd_{way}_{kind}" for way in _WAYS for kind in _KINDS),
)
_ON_AXES = {
    "cd_plane": "CD, point-to-plane",
    "cd_point": "CD, point-to-point",
    "hausdorff_sq_plane": "HD², point-to-plane",
    "d1_mse": "D1 MSE",
    "d2_mse": "D2 MSE",
}


def _distances(prefix: str, to: str, group: str, missing: str) -> Iterator[Column]:
    """Yield the columns of distances to one reference, whose names have the same prefix."""

    def distance(name: str, words: str, unit: str, **more: Any) -> Column:
        name, short = prefix + name, _ON_AXES.get(prefix + name, "")
        more |= {"summarised": name in _IN_SUMMARY, "missing": missing}
        return Column(name, words + to, unit, LOWER, group, short, **more)

    for kind, words in _KINDS.items():
        yield distance(f"cd_{kind}", f"Chamfer distance, {words}", SQUARED)
    for way, direction in _WAYS.items():
        for kind, words in _KINDS.items():
            text = f"Asymmetric Chamfer distance, {direction}, {words}"
            one_way = distance(f"acd_{way}_{kind}", text, SQUARED, bookkeeping=True)
            if group == TRUTH:
                one_way = replace(one_way, words=_WAYS_TO_TRUTH[way].format(words))
            yield one_way
    for kind, words in _KINDS.items():
        for name, text in (
            ("q99", f"99 % quantile of distances, {words}"),
            ("hausdorff", f"Hausdorff distance, {words}"),
        ):
            yield distance(f"{name}_{kind}", text, GRID)
            yield distance(f"{name}_{kind}_m", text, "m")
        yield distance(f"hausdorff_sq_{kind}", f"Squared Hausdorff distance, {words}", SQUARED)
    for kind, words in _MPEG.items():
        yield distance(f"{kind}_mse", f"Mean squared error {words}", SQUARED)
        printed = "" if prefix else f"{kind.upper()} error, m"
        yield distance(f"{kind}_rms_m", f"Root mean square error {words}", "m", printed=printed)
        if not prefix:
            yield distance(f"{kind}_mm2", f"Mean squared error {words}", "mm²")


def _psnrs() -> Iterator[Column]:
    psnr = partial(Column, unit="dB", better=HIGHER, group=CODED, missing=_LOSSLESS, decimals=1)
    first = partial(psnr, digits=".0f", leads=True, summarised=True)
    for kind, words in _MPEG.items():
        short = f"{kind.upper()} PSNR"
        yield first(f"{kind}_psnr", f"PSNR {words}", short=short, printed=f"{short}, dB")
    for kind, words in _KINDS.items():
        yield psnr(f"cd_psnr_{kind}", f"PSNR of the Chamfer distance, {words}")


def _of_the_cloud() -> Iterator[Column]:
    of_cloud = partial(Column, group=CLOUD)
    yield of_cloud("peak", "Peak of the PSNRs", GRID, leads=True)
    yield Column("lossless", "Lossless", leads=True)
    yield of_cloud("scale", "Scale")
    yield of_cloud("diameter", "Diameter", GRID)
    yield of_cloud("elongation", "Elongation")
    yield of_cloud("points_a", "Distinct points in")
    yield of_cloud("points_b", "Distinct points decoded")
    true = partial(of_cloud, counts=True, missing=_NO_TRUTH, bookkeeping=True)
    yield true("truth_points_a", "Distinct points of the true surface")
    yield true("truth_points_b", "Distinct points decoded, to the true surface")
    yield of_cloud("dropped_points", "Points left out", counts=True)
    yield of_cloud("missing_returns", "Missing returns", counts=True)
    yield of_cloud("file_bytes", "Size of the file", "bytes")
    yield of_cloud("file_attributes", "Attributes in the file")
    yield Column("scene", "Scene")
    yield Column(FRAME, "Coordinate frame", missing="the cloud is scaled")
    yield Column("digest", "Digest", bookkeeping=True)


# ---- times and memory


def _times() -> Iterator[Column]:
    for call, words in (("encode", "Encoding"), ("decode", "Decoding")):
        time = partial(Column, better=LOWER, group=COST, missing=_NOT_TIMED, timed=True)
        first = partial(time, leads=True, summarised=True)
        yield first(f"{call}_s", f"{words} time", "s", printed=f"{call}, s")
        for name, which in (("min", "least"), ("max", "most")):
            text = f"{words} time, {which} of the repetitions"
            yield time(f"{call}_s_{name}", text, "s", leads=True)
        turn = partial(time, missing=_NO_RETURNS)
        yield turn(f"{call}_ms_per_turn", f"{words} time of a turn", "ms")
        yield turn(f"{call}_real_time", f"{words} speed relative to the sensor", better=HIGHER)
    for call, words in (("encode", "encoding"), ("decode", "decoding")):
        memory = partial(Column, better=LOWER, group=COST, missing=_NOT_TIMED, leads=True)
        yield memory(f"{call}_peak_mib", f"Memory of {words}", "MiB")


# ---- the sensor's returns, pictures and attributes


def _returns() -> Iterator[Column]:
    error = partial(Column, better=LOWER, group=CODED, missing=_NO_RETURNS)
    text, short = "Root mean square range error", "RMS error of ranges"
    yield error("range_rms_mm", text, "mm", short=short, printed="range, mm")
    yield error("range_max_mm", "Largest range error", "mm")
    yield error("returns_lost", "Returns lost")
    yield error("returns_added", "Returns added")
    yield error("mbit_per_s", "Bitrate at the sensor's speed", "Mbit/s", group=COST)


def _pictures_and_attributes() -> Iterator[Column]:
    missing = f"lossless, or {_NO_ATTRIBUTE}"
    psnr = partial(Column, unit="dB", better=HIGHER, missing=missing, decimals=1)
    error = partial(Column, better=LOWER, missing=_NO_ATTRIBUTE)
    yield psnr("view_psnr", "PSNR of six rendered views", group=SEEN, missing=_LOSSLESS)
    yield Column("view_ssim", "SSIM of six rendered views", better=HIGHER, group=SEEN)
    for name, words in (("y", "luma"), ("u", "chroma, U"), ("v", "chroma, V")):
        yield psnr(f"{name}_psnr", f"PSNR of {words}", group=SEEN)
        yield error(f"{name}_mse", f"Mean squared error of {words}", group=SEEN)
    yield error("luminance_l2", "Distance of luminance histograms", group=SEEN)
    yield error("joint_quality", "Joint metric of geometry and colour", group=SEEN)
    text = "Largest error of red, green or blue, of 255"
    yield error("colour_max_error", text, group=SEEN)
    yield psnr("reflectance_psnr", "PSNR of reflectances", group=REFLECTANCE)
    yield error("reflectance_mse", "Mean squared error of reflectances", group=REFLECTANCE)
    yield error("reflectance_max_error", "Largest error of reflectances", group=REFLECTANCE)
    for kind, group in (("colour", SEEN), ("reflectance", REFLECTANCE)):
        text = f"Whether the {kind}s come back"
        yield Column(f"{kind}_lossless", text, group=group, missing=_NO_ATTRIBUTE)
    text = "Peak of the PSNR of reflectances"
    yield Column("reflectance_peak", text, group=CLOUD, missing=_NO_ATTRIBUTE)


# ---- recovered primitives


def _recovery() -> Iterator[Column]:
    for name in ("true", "found", "matched"):
        yield Column(name, f"{name.capitalize()} primitives", leads=True, counts=True)
    for name in ("precision", "recall", "label_accuracy"):
        yield Column(name, name_in_words(name), better=HIGHER, leads=True)
    no_match = "no primitive matched, or its kind has no such parameter"
    difference = partial(Column, better=LOWER, missing=no_match)
    yield difference("residual_m", "Residual", "m")
    yield difference("position_m", "Difference of positions", "m")
    yield difference("radius_m", "Difference of radii", "m")
    yield difference("angle_deg", "Angle between normals or axes", "°")
    yield difference("half_angle_deg", "Difference of half angles", "°")


# ---- clouds and drives, and how results were measured


def _clouds() -> Iterator[Column]:
    of_cloud = partial(Column, group=CLOUD)
    yield of_cloud("elongation_oriented", "Elongation of the oriented box")
    for axis in "xyz":
        yield of_cloud(f"size_{axis}_m", f"Size along {axis}", "m")
    yield of_cloud("spacing_m", "Distance to the nearest point", "m")
    yield of_cloud("density_m2", "Density", "1/m²")
    yield of_cloud("duplicates", "Share of duplicates")
    yield of_cloud("outliers", "Share of outliers")
    yield of_cloud("source", "File")
    of_sensor = partial(of_cloud, missing=_NO_RETURNS)
    yield of_sensor("sensor", "Sensor")
    yield of_sensor("turns", "Turns")
    yield of_sensor("seconds", "Seconds", missing=f"{_NO_RETURNS}, or {_NOT_TIMED}")
    yield of_sensor("firings", "Firings")
    yield of_cloud("error_model", "Error model")
    missing = "no virtual sensor with noise"
    yield of_cloud("noise_bits", "Entropy of the noise per return", "bits", missing=missing)


def _measurement() -> Iterator[Column]:
    how = partial(Column, group=RUN)
    yield how("used_rate", "Rate that meets the budget", missing="the rate is no budget of bits")
    yield how("codec_version", "Codec version")
    yield how("puckbench_version", "Puckbench version")
    yield how("weights", "Weights", missing="the codec has no weights", bookkeeping=True)
    yield how("cpu", "Processor")
    yield how("encode_cpu", "Processor that encoded")
    yield how("threads", "Threads")
    yield how("timed_alone", "Timed alone")
    yield how("repeats", "Repeats")
    yield how("libraries", "Libraries")
    yield how("remark", "Remark", missing="nothing unusual")
    yield how("not_coded", "Attributes that are not coded")
    yield how("seed", "Seed")
    yield how("poses", "Poses")
    yield how("times", "Times of points")
    yield how("length_m", "Length of the drive", "m")
    yield how("odometry", "Odometry")


# ---- what several tables have


def _comparisons() -> Iterator[Column]:
    yield Column("clouds", "Clouds", bookkeeping=True)
    yield Column("count", "Count", bookkeeping=True)
    for name in ("scenes", "anchor", "verdict", "metric", "distance", "quantity", "note"):
        yield Column(name, name.capitalize())
    yield Column("model", "Error model")
    error = partial(Column, unit="mm", better=LOWER)
    for kind, words in _MPEG.items():
        printed = f"{kind.upper()}, mm"
        yield error(f"{kind}_rms_mm", f"Root mean square error {words}", printed=printed)
    text = f"Root mean square error {_MPEG['d2']}, to the true surface"
    yield error("truth_d2_rms_mm", text, missing=_NO_TRUTH)
    yield error("q99_mm", f"99 % quantile of distances, {_POINT}", printed="99 %, mm")
    yield error("largest_mm", f"Largest distance, {_POINT}", printed="largest, mm")
    yield error("mm", "Distance to the true surface")
    bits = partial(Column, better=LOWER)
    for mm in (1, 2):
        yield bits(f"grid_{mm}_mm", f"Bits per return on a {mm} mm grid", missing=NO_RATE)
    for mm in (5, 10, 20):
        text = f"Bits per return at a D1 error of {mm} mm"
        yield bits(f"at_{mm}_mm", text, missing=NO_COMMON_ERROR)


def _of_odometry_tables() -> Iterator[Column]:
    for name, words in (
        ("bits", "Bits"),
        ("measure", "Measure"),
        ("unit", "Unit"),
        ("trajectories", "Trajectories"),
        ("undecoded", "Error without coding"),
        ("value", "Error"),
        ("difference", "Difference to no coding"),
        ("low", "Interval from"),
        ("high", "Interval to"),
        ("margin", "Margin"),
    ):
        yield Column(name, words)


declare(_keys_and_sizes())
declare(_distances("", "", CODED, ""))
declare(_psnrs())
declare(_distances("truth_", ", to the true surface", TRUTH, _NO_TRUTH))
declare(_distances("clean_", ", to the clean scan", CLEAN, _NO_SCAN))
for _columns in (
    *(_of_the_cloud, _times, _returns, _pictures_and_attributes, _recovery),
    *(_clouds, _measurement, _comparisons, _of_odometry_tables),
):
    declare(_columns())
