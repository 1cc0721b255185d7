"""puckbench as a library: codecs, shipped or of one's own, measured on clouds in memory."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from puckbench.codecs.base import Codec
from puckbench.codecs.measurement import measured
from puckbench.codecs.registry import open_codec
from puckbench.core.errors import InputError
from puckbench.geometry.cloud import PointCloud
from puckbench.io.clouds import read_cloud
from puckbench.jobs.codecs import ready
from puckbench.metrics.measures import measures, peak_of

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Codec", "InputError", "PointCloud", "compare", "open_codec", "prepare", "read_cloud"]


def prepare(cloud: PointCloud, size: int | str = 1024, neighbours: int = 30) -> PointCloud:
    """See `puckbench.jobs.preparation.prepare`: normals, scaling to [0, size - 1]."""
    from puckbench.jobs import preparation

    return preparation.prepare(cloud, size, neighbours)


def compare(cloud: PointCloud, codecs: Iterable[Codec], repeats: int = 1) -> pd.DataFrame:
    """One row for each codec and rate, with the columns of a run's ``metrics.csv``.

    cloud: as `prepare` gives it; one without normals has no distances to planes. repeats: timed
    calls, whose median counts. The peak of the PSNRs is ``size - 1`` of the cloud's preparation, or
    else 1023. InputError for a codec that cannot run here, or cannot code the cloud.
    """
    import pandas as pd

    rows = [
        _row(cloud, codec, rate, repeats) for codec in map(ready, codecs) for rate in codec.rates
    ]
    return pd.DataFrame(rows)


def _row(cloud: PointCloud, codec: Codec, rate: str, repeats: int) -> dict[str, object]:
    coded = measured(lambda: codec.encode(cloud.xyz, rate), repeats, codec.cost)
    decoded = measured(lambda: codec.decode(coded.result), repeats, codec.cost)
    return {
        "codec": codec.name,
        "rate": rate,
        "bytes": len(coded.result),
        "bpp": 8 * len(coded.result) / len(cloud),
        **coded.costs("encode"),
        **decoded.costs("decode"),
        **measures(cloud, decoded.result, peak_of(cloud)),
    }
