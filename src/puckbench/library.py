from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from numbers import Integral, Real
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from cloud_files.clouds import read_cloud
from pointkit.errors import InputError, closest, naming
from pointkit.geometry.cloud import Floats, PointCloud, check_points
from pointkit.models import parsed
from pointkit.registry import trust
from puckbench.codecs import coding, registry
from puckbench.codecs.base import CloudKind, Codec, SharedWork
from puckbench.codecs.budget import rate_within
from puckbench.codecs.coding import check_codes
from puckbench.codecs.rates import Budget, rates_of, scaled_rates
from puckbench.metrics.cloud_metrics import attribute_metrics, geometry_metrics
from puckbench.results.curves import read_curve
from puckbench.steps.coding import TimingSettings, codec_plugins, decoded_cloud, ready
from puckbench.steps.encode import coded_cloud

if TYPE_CHECKING:
    import pandas as pd

    from puckbench.metrics.geometry import ReferenceCloud

__all__ = [
    "Codec",
    "InputError",
    "PointCloud",
    "bd_rate",
    "compare",
    "decoded",
    "encoded",
    "encoded_within",
    "measures",
    "open_codec",
    "prepare",
    "read_cloud",
    "read_curve",
    "turns",
]


class WithinBudget(NamedTuple):
    """A stream that meets a number of bits per point, as `encoded_within` returns it.

    Parameters
    ----------
    stream
        The byte string, which `decoded` decodes.
    rate
        Name of the rate: a length such as ``12.3mm``, ``scale_0.43`` (the factor by which
        coordinates were multiplied before they were rounded), or a named rate of the codec.
    bpp
        Bits per point that the stream takes.
    encodings
        Number of encodings that the search took.
    remark
        One line if the codec has fixed rates, or if more than 2 % of the bits are left; else None.
    """

    stream: bytes
    rate: str
    bpp: float
    encodings: int
    remark: str | None


def open_codec(name: str, changes: Mapping[str, Any] | None = None) -> Codec:
    """Create a codec from its name, or from a class in a user's file.

    Parameters
    ----------
    name
        Name of a codec (``puckbench codecs`` lists them), or ``path/to/file.py:Class``. In the
        second form the file is executed, so `name` must come from a source that you trust.
    changes
        Changes to the codec's defaults, with the keys of a codec's entry in a configuration:
        ``options``, ``rates``, ``metric_rates``, ``class``.

    Returns
    -------
    Codec
        The codec, which can both encode and decode.

    Raises
    ------
    InputError
        The codec, or a key, option or rate of `changes`, is unknown or not valid.
    """
    from puckbench.planning.config import CodecConfig

    if not isinstance(name, str):
        raise InputError(f"a codec's name is a string, not {type(name).__name__}")
    entry = parsed(CodecConfig, changes or {}, f"codec {name}").changes()
    trust(codec_plugins(name, entry))
    return registry.open_codec(name, entry)


def turns(
    recording: str | Path, stream: str | None = None, topic: str | None = None
) -> Iterator[PointCloud]:
    """Yield the whole turns of a recording as point clouds.

    A turn is one revolution of a spinning sensor; incomplete turns are skipped. Each cloud has its
    points in m, in the sensor's coordinate frame, and the ranges from which they were computed in
    its attribute ``returns``. A ROS bag may instead contain messages with finished clouds. For such
    a bag, one cloud per message is yielded, in the message's coordinate frame and without
    ``returns``.

    Parameters
    ----------
    recording
        A packet capture, a ROS bag, or a compressed recording (.puck).
    stream
        Address and port of the sensor, needed if the capture has packets of several sensors.
    topic
        Topic of a ROS bag, needed if the bag has several suitable topics.

    Yields
    ------
    PointCloud
        The turns, or the clouds of the messages, in the order of the recording.

    Raises
    ------
    InputError
        The recording cannot be read, or its sensor is unknown.
    """
    from puckbench.recordings import cloud_messages
    from puckbench.recordings.reading import read_turns
    from puckbench.scene_sets.recordings import decompressed

    path = Path(recording)
    with decompressed(path) as readable:
        if cloud_messages.has_clouds(readable, topic):
            name, (_, count) = cloud_messages.cloud_topic(readable, topic)
            for number in range(count):
                yield cloud_messages.read_recorded_cloud(readable, number, name, source=path)
            return
        recorded = read_turns(readable, stream=stream, source=path, topic=topic)
    for number in recorded.whole:
        whole = replace(recorded.returns, turns=(recorded.returns.turns[number],))
        yield PointCloud(whole.points(), returns=whole)


def measures(
    original: PointCloud | Floats,
    decoded: PointCloud | Floats,
    peak: float | None = None,
    metrics: Iterable[str] = (),
) -> dict[str, float]:
    """Measure how far a decoded cloud differs from the original cloud.

    Parameters
    ----------
    original, decoded
        Two clouds, or two arrays of points (n, 3) and (m, 3), in the same coordinate frame. Metrics
        D2 (point to plane) need normals in `original`.
    peak
        Peak of MPEG's PSNRs, in the unit of the coordinates. By default, it is the original's
        ``size - 1``; without a size and a peak, these PSNRs are omitted.
    metrics
        Names of further metrics, as in a configuration, such as "pcqm" for coloured clouds.

    Returns
    -------
    dict
        Values by name of the metric. It contains metrics of the geometry; metrics of the attributes
        that both clouds have; and, if both clouds have ``returns``, errors of the ranges.
    """
    from puckbench.metrics.metric_registry import further_metrics
    from puckbench.metrics.sensor_metrics import decoded_range_errors

    original, decoded = _cloud(original), _cloud(decoded)
    _check_peak(peak, "measures")
    values = geometry_metrics(original, decoded.xyz, peak)
    values |= attribute_metrics(original, decoded, values)
    if not (original.returns is None or decoded.returns is None):
        values |= decoded_range_errors(original.xyz, original.returns, decoded)
    return values | further_metrics(metrics, original, decoded, values)


def prepare(cloud: PointCloud | Floats, size: int | str = 1024, neighbours: int = 30) -> PointCloud:
    """Scale a cloud to a cube of integer size, and estimate a normal for each point.

    Parameters
    ----------
    cloud
        A cloud, or an array of points (n, 3), in m.
    size
        Number of grid positions along a side of the cube to which the cloud is scaled. 0 keeps
        metres; ``"grid"`` keeps the integer grid of a voxelised cloud.
    neighbours
        Number of nearest neighbours from which each normal is estimated.

    Returns
    -------
    PointCloud
        The scaled cloud with its normals.

    Raises
    ------
    InputError
        The cloud is empty or has no extent, or an argument is not valid.
    """
    from puckbench.geometry.scaling import METRIC
    from puckbench.steps import preparation
    from puckbench.steps.prepare import PreparationSettings

    plain = size.item() if isinstance(size, np.integer) else size
    number = neighbours.item() if isinstance(neighbours, np.integer) else neighbours
    given = {"size": METRIC if plain == 0 else plain, "neighbours": number}
    settings = parsed(PreparationSettings, given, "prepare")
    points = _cloud(cloud)
    check_points(points.xyz, "the cloud")
    return preparation.prepare(points, settings.size, settings.neighbours)


def encoded(codec: Codec, cloud: PointCloud | Floats, rate: str, work: Any = None) -> bytes:
    """Encode a cloud at a rate of a codec to a self-contained byte string.

    A cloud far from the origin is shifted towards it before encoding (`puckbench.codecs.shift`).

    Parameters
    ----------
    codec
        A codec returned by `open_codec`.
    cloud
        A cloud, or an array of points (n, 3). If the coordinate frame is unknown and the rate is a
        length, the coordinates are taken as metres.
    rate
        Name of a rate, or a length such as "15mm" if the codec allows any.
    work
        Object from the codec's `prepare` for this cloud. It saves time and does not affect the
        result.

    Raises
    ------
    InputError
        The rate is unknown, the codec skips the cloud (`Codec.skip`), the cloud is empty, a
        reflectance is not a 16-bit integer, or the codec cannot encode the cloud.
    """
    return coding.encoded(_codec(codec), _cloud(cloud), rate, work)


def encoded_within(
    codec: Codec, cloud: PointCloud | Floats, bpp: float, work: Any = None
) -> WithinBudget:
    """Encode a cloud at the rate of a codec that meets a number of bits per point.

    If a step is the only parameter of the codec's rates, the stream takes 98 to 100 % of the bits
    (less if the finest step needs less, or if bits leap between two steps). The step is found by at
    most eight encodings. Any other codec takes the largest of its rates below.

    Parameters
    ----------
    codec
        A codec returned by `open_codec`.
    cloud
        A cloud, or an array of points (n, 3). If the coordinate frame is unknown, and the codec has
        rates that are lengths, the coordinates are taken as metres.
    bpp
        The most bits per point of the cloud.
    work
        Object from the codec's `prepare` for this cloud, as in `encoded`.

    Returns
    -------
    WithinBudget
        The stream, the rate that was found, and what it takes.

    Raises
    ------
    InputError
        The coarsest rate of the codec takes more bits; the message has the range that is in reach.
        Or `encoded` would raise it for the cloud.
    """
    streams: dict[str, bytes] = {}

    def encode(rated: Codec, rate: str) -> int:
        streams[rate] = coding.encoded(rated, points, rate, work)
        return len(streams[rate])

    points = _cloud(cloud)
    check_points(points.xyz, "the cloud")
    if not (isinstance(bpp, Real) and 0 < bpp < math.inf):
        raise InputError(f"bpp is {bpp!r}, but must be a number above 0")
    chosen = rate_within(_codec(codec), [points], Budget(float(bpp), "bpp"), encode)
    stream = streams[chosen.rate]
    taken = 8 * len(stream) / len(points)
    return WithinBudget(stream, chosen.rate, taken, chosen.probes, chosen.remark)


def decoded(codec: Codec, stream: bytes) -> PointCloud:
    """Decode a byte string to a cloud, in the coordinate frame of the encoded cloud.

    Parameters
    ----------
    codec
        The codec that encoded the cloud, returned by `open_codec`.
    stream
        Result of `encoded`.

    Returns
    -------
    PointCloud
        Points (m, 3), with the returns and attributes that the byte string contains.

    Raises
    ------
    InputError
        The byte string is damaged, or belongs to another codec.
    """
    return coding.decoded(_codec(codec), stream)


def _codec(codec: Codec) -> Codec:
    if not isinstance(codec, Codec):
        raise InputError(f"{codec!r} is not a codec (open_codec returns codecs)")
    return codec


def _cloud(cloud: PointCloud | Floats) -> PointCloud:
    if isinstance(cloud, PointCloud):
        return cloud
    if isinstance(cloud, np.ndarray):
        return PointCloud(cloud)
    raise InputError(f"expected a PointCloud or points (n, 3), not {type(cloud).__name__}")


def compare(
    cloud: PointCloud | Floats,
    codecs: Iterable[Codec],
    repeats: int = 1,
    peak: float | None = None,
) -> pd.DataFrame:
    """Encode and decode a cloud with several codecs at all their rates, and measure the results.

    Parameters
    ----------
    cloud
        A cloud returned by `prepare`, whose normals metrics D2 need. For points that are already
        scaled, pass ``PointCloud(points, about={"size": 1024})``.
    codecs
        Codecs returned by `open_codec`.
    repeats
        How many times each encoding and each decoding is timed; the median is returned.
    peak
        Peak of MPEG's PSNRs, in the unit of the coordinates. By default, it is the cloud's ``size -
        1``; without a size and a peak, these PSNRs are omitted.

    Returns
    -------
    pandas.DataFrame
        A row for each codec and rate, with the columns of a run's ``metrics.csv``: size of the
        stream, bits per point, times and the machine that took them, and errors of the decoded
        cloud.

    Raises
    ------
    InputError
        A codec cannot run here, or cannot encode the cloud.
    """
    import pandas as pd

    from puckbench.metrics.geometry import ReferenceCloud

    cloud, chosen = _cloud(cloud), [codecs] if isinstance(codecs, Codec) else list(codecs)
    _check_peak(peak, "compare")
    if not (isinstance(repeats, Integral) and repeats >= 1):
        raise InputError(f"repeats is {repeats!r}, but must be a whole number from 1 on")
    for codec in chosen:
        check_codes(_codec(codec), CloudKind.of(cloud))
    cells = [
        (codec, rate, shared)
        for codec, shared in [(ready(codec), codec.prepare(cloud)) for codec in chosen]
        for rate in rates_of(codec, cloud.frame) or scaled_rates(codec.rates)
    ]
    reference = ReferenceCloud(cloud)
    return pd.DataFrame([_row(reference, *cell, repeats, peak) for cell in cells])


def bd_rate(anchor: pd.DataFrame, tested: pd.DataFrame, quality: str = "d1_psnr") -> float:
    """Return how many more or fewer bits a codec needs than another at equal quality, in percent.

    It is the Bjontegaard delta rate of the table ``bd_rate_clouds``: the mean difference of the
    logarithms of the bits, interpolated by PCHIP, over the range that both curves share. It is
    negative if the tested codec needs fewer bits. Lossless rates are left out.

    Parameters
    ----------
    anchor, tested
        Rows of one codec each, for one cloud, of the table that `compare` returns or of a run's
        ``metrics.csv``.
    quality
        Column that measures quality. Values in dB are kept, a length d is converted to -20 log10 d,
        and any other value d to -10 log10 d.

    Raises
    ------
    InputError
        A table has rows of several codecs or clouds, or lacks a column; bits are not positive;
        PSNRs have different peaks; a curve has fewer than four points; or the curves have less than
        half of the shorter one's range in common.
    """
    from puckbench.tables.rate_deltas import bd_rate_of_curves

    for name, rows in (("anchor", anchor), ("tested", tested)):
        with naming(name):
            _check_curve(rows, quality)
    return bd_rate_of_curves(anchor, tested, quality)


def _check_curve(rows: pd.DataFrame, quality: str) -> None:
    import pandas as pd

    from pointkit.tables import check_columns

    if not isinstance(rows, pd.DataFrame):
        raise InputError(f"expected rows of the table of compare, not {type(rows).__name__}")
    if quality not in rows:
        names = [str(name) for name in rows]
        raise InputError(f"no column '{quality}'{closest(str(quality), names)}")
    check_columns(rows, ("rate",), ("bpp", quality))
    for column in ("codec", "dataset", "cloud"):
        if column in rows and (count := rows[column].nunique()) > 1:
            raise InputError(f"rows of {count} {column}s: select those of one")


def _check_peak(peak: float | None, what: str) -> None:
    from puckbench.steps.evaluate import MeasuringSettings

    plain = float(peak) if isinstance(peak, Real) else peak
    parsed(MeasuringSettings, {"peak": plain}, what)


def _row(
    reference: ReferenceCloud,
    codec: Codec,
    rate: str,
    shared: SharedWork | None,
    repeats: int,
    peak: float | None,
) -> dict[str, object]:
    timing = TimingSettings(repeats=repeats)
    coded = coded_cloud(codec, reference.cloud, rate, timing, shared)
    cloud, record = decoded_cloud(codec, coded, timing)
    errors = geometry_metrics(reference, cloud.xyz, peak)
    return {**record, **errors, **attribute_metrics(reference.cloud, cloud, errors)}
