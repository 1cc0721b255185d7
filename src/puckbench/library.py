from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from numbers import Integral, Real
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cloud_files.clouds import read_cloud
from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats, PointCloud, check_points
from pointkit.measurement import measured
from pointkit.models import parsed
from pointkit.registry import trust
from puckbench.codecs import registry
from puckbench.codecs.base import Codec, SharedWork
from puckbench.jobs.codec_jobs import codec_plugins, ready
from puckbench.jobs.curve_files import read_curve
from puckbench.jobs.encode_curve import measured_encoding
from puckbench.metrics.cloud_metrics import attribute_metrics, geometry_metrics

if TYPE_CHECKING:
    import pandas as pd

    from puckbench.metrics.geometry import ReferenceCloud

__all__ = [
    "Codec",
    "InputError",
    "PointCloud",
    "compare",
    "measures",
    "open_codec",
    "prepare",
    "read_cloud",
    "read_curve",
    "turns",
]


def open_codec(name: str, changes: Mapping[str, Any] | None = None) -> Codec:
    """Create a codec by its name, or from a user's class.

    Parameters
    ----------
    name
        Name of a codec, or ``path/to/file.py:Class``. The file is run, so the name must come from
        a trusted source.
    changes
        A configuration's entry: ``options``, ``rates``, ``metric_rates``, ``class``.

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
    """Yield each full turn in a recording as a cloud with returns, in m, in the sensor's frame.

    From a bag of clouds, yield each message as a cloud without returns, in its coordinate frame.

    Parameters
    ----------
    recording
        A packet capture, a ROS bag, or a compressed recording (.puck).
    stream
        Address and port of the sensor, if the capture has several streams.
    topic
        Topic of a ROS bag, if several are suitable.

    Raises
    ------
    InputError
        The recording cannot be read, or its sensor is unknown.
    """
    from puckbench.datasets.recordings import decompressed
    from puckbench.recordings import cloud_messages
    from puckbench.recordings.reading import read_turns

    path = Path(recording)
    if cloud_messages.has_clouds(path, topic):
        name, (_, count) = cloud_messages.cloud_topic(path, topic)
        for number in range(count):
            yield cloud_messages.read_recorded_cloud(path, number, name)
        return
    with decompressed(path) as readable:
        recorded = read_turns(readable, stream=stream, source=path, topic=topic)
    for number in recorded.whole:
        whole = replace(recorded.returns, turns=(recorded.returns.turns[number],))
        yield PointCloud(whole.points(), returns=whole)


def measures(
    original: PointCloud | Floats, decoded: PointCloud | Floats, peak: float | None = None
) -> dict[str, float]:
    """Return metrics of a decoded cloud's geometry, and of attributes and returns of both clouds.

    Parameters
    ----------
    original, decoded
        Clouds, or points (n, 3), in the same coordinate frame; D2 needs normals in the original.
    peak
        As in `compare`.
    """
    from puckbench.metrics.sensor_metrics import decoded_range_errors

    original, decoded = _cloud(original), _cloud(decoded)
    _check_peak(peak)
    metrics = geometry_metrics(original, decoded.xyz, peak)
    metrics |= attribute_metrics(original, decoded, metrics)
    if original.returns is None or decoded.returns is None:
        return metrics
    return metrics | decoded_range_errors(original.xyz, original.returns, decoded)


def prepare(cloud: PointCloud | Floats, size: int | str = 1024, neighbours: int = 30) -> PointCloud:
    """Return a cloud scaled to a cube of whole positions, with a normal for each point.

    Parameters
    ----------
    cloud
        A cloud, or points (n, 3), in m.
    size, neighbours
        As in `puckbench.jobs.prepare.Prepare`.

    Raises
    ------
    InputError
        The cloud is empty or has no extent, or an argument is not valid.
    """
    from puckbench.jobs import preparation
    from puckbench.jobs.prepare import Prepare

    given = {"size": size, "neighbours": neighbours}
    plain = {name: n.item() if isinstance(n, np.integer) else n for name, n in given.items()}
    job = Prepare.create(**plain)
    points = _cloud(cloud)
    check_points(points.xyz, "the cloud")
    return preparation.prepare(points, job.size, job.neighbours)


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
    """Return a row for each codec and rate, with the columns of a run's ``metrics.csv``.

    Parameters
    ----------
    cloud
        A cloud returned by `prepare`, with normals for D2. For points that are already scaled, pass
        ``PointCloud(points, about={"size": 1024})``.
    codecs
        Codecs returned by `open_codec`.
    repeats
        Number of timed calls; the median is returned.
    peak
        Peak of MPEG's PSNRs, by default the cloud's ``size - 1``. Without a peak, PSNRs are
        omitted.

    Raises
    ------
    InputError
        A codec cannot run here, or cannot encode the cloud.
    """
    import pandas as pd

    from puckbench.metrics.geometry import ReferenceCloud

    cloud, chosen = _cloud(cloud), [codecs] if isinstance(codecs, Codec) else list(codecs)
    _check_peak(peak)
    if not (isinstance(repeats, Integral) and repeats >= 1):
        raise InputError(f"repeats is {repeats!r}, but must be a whole number from 1 on")
    for codec in chosen:
        if not isinstance(codec, Codec):
            raise InputError(f"codecs: {codec!r} is not a codec (open_codec returns codecs)")
        codec.check_frame(cloud.frame)
    cells = [
        (codec, rate, shared)
        for codec, shared in [(ready(codec), codec.shared_work()) for codec in chosen]
        for rate in codec.rates_of(cloud.frame) or codec.rates
    ]
    reference = ReferenceCloud(cloud)
    return pd.DataFrame([_row(reference, *cell, repeats, peak) for cell in cells])


def _check_peak(peak: float | None) -> None:
    if not (peak is None or (isinstance(peak, Real) and 0 < peak < np.inf)):
        raise InputError(f"peak is {peak!r}, but must be a positive number")


def _row(
    reference: ReferenceCloud,
    codec: Codec,
    rate: str,
    shared: SharedWork | None,
    repeats: int,
    peak: float | None,
) -> dict[str, object]:
    cloud = reference.cloud
    coded = measured_encoding(codec, cloud, rate, repeats, shared)
    decoded = measured(lambda: codec.decode_cloud(coded.result), repeats, codec.cost)
    errors = geometry_metrics(reference, decoded.result.xyz, peak)
    return {
        "codec": codec.name,
        "rate": rate,
        "bytes": len(coded.result),
        "bpp": 8 * len(coded.result) / len(cloud),
        **coded.costs("encode"),
        **decoded.costs("decode"),
        **errors,
        **attribute_metrics(cloud, decoded.result, errors),
    }
