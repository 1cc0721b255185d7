from __future__ import annotations

import math
from typing import Literal

from pydantic import Field

from gpcc.options import PROFILES, SPINNING, GpccOptions
from puckbench.codecs.gpcc import CoderOptions, SensorCodec
from puckbench.codecs.rates import Parameters
from puckbench.codecs.registry import CODECS

CODE = ("puckbench.codecs.gpcc",)

_LOWEST_LOG2, _FLATTEST_LOG2 = 8, 1


class AngularOptions(CoderOptions):
    duplicates: Literal["merged", "kept", "by_rate"] = "by_rate"
    direct_coding: Literal[0, 1, 2, 3] = Field(
        1,
        description="points are coded directly 0 never, 1 in isolated nodes, 2 in nodes without "
        "neighbours, 3 in any node",
    )


@CODECS.register("gpcc_angular")
class GpccAngular(SensorCodec):
    """The codec is G-PCC's octree in angular mode, whose contexts depend on the sensor's lasers.

    The tools are those of MPEG's common test conditions for spinning sensors. Lossy rates merge
    points with equal grid positions. Only points of isolated nodes are coded directly. Direct
    coding in any node (`direct_coding` 3), as in the lossless conditions, takes more bits.
    """

    Options = AngularOptions
    options: AngularOptions

    def _tools(self, parameters: Parameters, *, angular: bool = False) -> GpccOptions:
        """Return the coding tools for a rate.

        Limits on node heights are in log2 of grid steps, but equal in metres at every rate.
        """
        step = float(parameters.get("step_m", self.options.step))
        finer = int(math.log2(0.001 / step)) if step < 1 else 0
        sizes = {
            "angular_max_node_min_dim_log2_to_split_z": min(max(_LOWEST_LOG2 + finer, 0), 21),
            "angular_max_diff_to_split_z": min(max(_FLATTEST_LOG2 + finer, 0), 21),
        }
        merged = {"merge_duplicates": self._merges(parameters)}
        direct = {"inferred_direct_coding_mode": self.options.direct_coding}
        chosen = {**SPINNING, **sizes, **merged, **direct}
        return PROFILES[self.options.profile].model_copy(update=chosen)
