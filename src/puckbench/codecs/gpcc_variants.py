"""G-PCC with other options and rates than `gpcc`, as codecs of their own.

References
----------
Configurations for KITTI and Ford in the repositories of SparsePCGC (``test/kitti.cfg``),
OctAttention (``file/kitti.cfg``) and Unicorn (``third_party/gpcc_cfg/ford.cfg``).
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal

from puckbench.codecs.base import Parameters
from puckbench.codecs.gpcc import Gpcc, GridOptions
from puckbench.codecs.registry import CODECS
from puckbench.gpcc.grid import Rounding
from puckbench.gpcc.options import PROFILES, SPINNING, GpccOptions


class ArenaOptions(GridOptions):
    """As PCC Arena and the thesis ran it: TMC13's defaults, coordinates truncated."""

    profile: Literal["minimal", "ctc", "defaults"] = "defaults"
    rounding: Rounding = "truncate"


@CODECS.register("gpcc_arena")
class GpccArena(Gpcc):
    """G-PCC as PCC Arena and the thesis ran it."""

    title = "G-PCC (PCC Arena)"
    use = "comparison with the thesis, which ran G-PCC so"
    colour = "#8C6000"
    marker = "X"
    line = "--"
    rank = 70
    metric_rates: Mapping[str, Parameters] = MappingProxyType({})
    Options = ArenaOptions
    options: ArenaOptions


@CODECS.register("gpcc_dyadic")
class GpccDyadic(Gpcc):
    """G-PCC at scales that are powers of two, on which its octree loses nothing."""

    title = "G-PCC (dyadic scales)"
    use = "rate deltas, on scales at which an octree loses nothing"
    colour = "#F2C766"
    marker = "p"
    line = "-."
    rank = 80
    metric_rates: Mapping[str, Parameters] = MappingProxyType({})
    rates: Mapping[str, Parameters] = {f"r{n}": {"scale": 2.0 ** (n - 7)} for n in range(1, 8)}


class NoSensorOptions(GridOptions):
    """As MPEG's conditions have it: all points where nothing is lost, else one of each position."""

    duplicates: Literal["merged", "kept", "by_rate"] = "by_rate"


@CODECS.register("gpcc_no_sensor")
class GpccNoSensor(Gpcc):
    """G-PCC as papers on LiDAR run it: MPEG's options for spinning sensors, without a sensor.

    That is angularEnabled 0 beside the options of the common test conditions for frames of such
    sensors, by which more points are coded directly than in `gpcc`: those of isolated nodes and,
    without loss, of any node.
    """

    title = "G-PCC (no sensor)"
    use = "comparison with papers on LiDAR, which run G-PCC so"
    colour = "#8A8A00"
    marker = "D"
    line = "--"
    rank = 75
    Options = NoSensorOptions
    options: NoSensorOptions

    def _options(self, parameters: Parameters) -> GpccOptions:
        lossy = {"inferred_direct_coding_mode": 1} if self._loses(parameters) else {}
        merged = {"merge_duplicates": self._merges(parameters)}
        return PROFILES[self.options.profile].model_copy(update={**SPINNING, **lossy, **merged})


class LosslessOptions(GridOptions):
    """Every point is coded, also where several have one position."""

    duplicates: Literal["merged", "kept", "by_rate"] = "kept"


@CODECS.register("gpcc_lossless")
class GpccLossless(Gpcc):
    """G-PCC that keeps every point: of multiples of 1 / scale, or of a step, nothing is lost."""

    title = "G-PCC (every point)"
    use = "every point, as exactly as is asked for"
    colour = "#C0A030"
    marker = "8"
    line = ":"
    rank = 90
    rates: Mapping[str, Parameters] = {f"r{n}": {"scale": 2 ** (n - 1)} for n in range(1, 6)}
    Options = LosslessOptions
    options: LosslessOptions
