from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import numpy as np

from pointkit.errors import noting
from pointkit.geometry.cloud import PointCloud, check_points
from pointkit.measurement import measured
from puckbench.codecs.coding import cost_of, decoded
from puckbench.core.code import CODEC
from puckbench.core.environment import run_environment
from puckbench.jobs.codec_jobs import TimedJob
from puckbench.jobs.curve_files import REMARK, Coded

CODE = CODEC


class Decoded(NamedTuple):
    """A decoded cloud, and facts about its encoding and decoding by column of results."""

    cloud: PointCloud
    record: dict[str, Any]


class Decoding(TimedJob):
    """Base class of jobs that decode streams.

    If the setting `codec` is None, each stream determines the codec that decodes it.
    """

    def decoded(self, coded: Coded, again: bool = False) -> Decoded:
        """Decode a stream, and measure the time and memory of the decoding.

        Parameters
        ----------
        coded
            The stream and its record.
        again
            Whether to decode once more if the codec is the user's own. If the points differ, the
            record gets a remark.
        """
        name = self.codec_of(coded)
        codec = self.loaded(name)
        with noting(f"rate {coded.record.get('rate', '?')}"):
            timed = measured(
                lambda: decoded(codec, coded.stream), self.repeats, partial(cost_of, codec)
            )
            check_points(timed.result.xyz, f"codec {name}: decoded points")
            again = again and self.runs_twice(codec)
            differ = again and not np.array_equal(
                decoded(codec, coded.stream).xyz, timed.result.xyz
            )
        remarks = [coded.record.get(REMARK), "repeated decodings differ" if differ else None]
        record = {
            **coded.record,
            **({REMARK: "; ".join(filter(None, remarks))} if any(remarks) else {}),
            "codec": name,
            "bytes": len(coded.stream),
            "points_out": len(timed.result),
            **timed.costs("decode"),
            **run_environment(self.alone),
        }
        return Decoded(timed.result, record)
