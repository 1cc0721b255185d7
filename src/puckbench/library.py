"""puckbench as a library: codecs, shipped or of one's own, measured on clouds in memory."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from puckbench.codecs import registry
from puckbench.codecs.base import Codec, SharedWork
from puckbench.core.errors import InputError
from puckbench.core.measurement import measured
from puckbench.core.registry import trust
from puckbench.geometry.cloud import PointCloud
from puckbench.io.clouds import read_cloud
from puckbench.jobs.codec_jobs import codec_plugins, ready
from puckbench.jobs.curve_files import read_curve
from puckbench.jobs.encode import measured_encoding
from puckbench.metrics.cloud_metrics import geometry_metrics

if TYPE_CHECKING:
    import pandas as pd

    from puckbench.metrics.geometry import ReferenceCloud

__all__ = [
    "Codec",
    "InputError",
    "PointCloud",
    "compare",
    "open_codec",
    "prepare",
    "read_cloud",
    "read_curve",
]


def open_codec(name: str, changes: Mapping[str, Any] | None = None) -> Codec:
    """A codec of a name, of a user's own class, or of an installed package.

    Parameters
    ----------
    name
        Of a codec, or ``path/to/file.py:Class``, which is run: not for names from files of data.
    changes
        As `puckbench.codecs.registry.entry` takes them; ``class`` is run as well.
    """
    trust(codec_plugins(name, changes or {}))
    return registry.open_codec(name, changes)


def prepare(cloud: PointCloud, size: int | str = 1024, neighbours: int = 30) -> PointCloud:
    """See `puckbench.jobs.preparation.prepare`: normals, scaling to [0, size - 1]."""
    from puckbench.jobs import preparation

    return preparation.prepare(cloud, size, neighbours)


def compare(
    cloud: PointCloud, codecs: Iterable[Codec], repeats: int = 1, peak: float | None = None
) -> pd.DataFrame:
    """One row for each codec and rate, with the columns of a run's ``metrics.csv``.

    Parameters
    ----------
    cloud
        As `prepare` gives it; one without normals has no distances to planes. A scaled cloud from
        elsewhere says so: ``PointCloud(points, about={"size": 1024})``.
    codecs
        As `open_codec` gives them.
    repeats
        Timed calls, whose median counts.
    peak
        Of MPEG's PSNRs; by default ``size - 1`` of the cloud, without which they are left out.

    Raises
    ------
    InputError
        A codec cannot run here, or cannot code the cloud.
    """
    import pandas as pd

    from puckbench.metrics.geometry import ReferenceCloud

    chosen = list(codecs)
    for codec in chosen:
        codec.check_frame(cloud.frame)
    cells = [
        (codec, rate, shared)
        for codec, shared in [(ready(codec), codec.shared_work()) for codec in chosen]
        for rate in codec.rates_of(cloud.frame) or codec.rates
    ]
    reference = ReferenceCloud(cloud)
    return pd.DataFrame([_row(reference, *cell, repeats, peak) for cell in cells])


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
    decoded = measured(lambda: codec.decode(coded.result), repeats, codec.cost)
    return {
        "codec": codec.name,
        "rate": rate,
        "bytes": len(coded.result),
        "bpp": 8 * len(coded.result) / len(cloud),
        **coded.costs("encode"),
        **decoded.costs("decode"),
        **geometry_metrics(reference, decoded.result, peak),
    }
