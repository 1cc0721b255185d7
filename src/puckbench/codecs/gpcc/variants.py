"""G-PCC with other options and rates than `gpcc`, as codecs of their own."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal

from puckbench.codecs.base import Parameters
from puckbench.codecs.gpcc.codec import Gpcc, GridOptions
from puckbench.codecs.gpcc.grid import Rounding
from puckbench.codecs.registry import CODECS


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


class LosslessOptions(GridOptions):
    """Every point is coded, also where several have one position."""

    duplicates: Literal["merged", "kept", "by_rate"] = "kept"


@CODECS.register("gpcc_lossless")
class GpccLossless(Gpcc):
    """G-PCC at finer scales: of coordinates that are multiples of 1 / scale nothing is lost."""

    title = "G-PCC (finer scales)"
    use = "every point, as exactly as is asked for"
    colour = "#C0A030"
    marker = "8"
    line = ":"
    rank = 90
    rates: Mapping[str, Parameters] = {f"r{n}": {"scale": 2 ** (n - 1)} for n in range(1, 6)}
    Options = LosslessOptions
    options: LosslessOptions
