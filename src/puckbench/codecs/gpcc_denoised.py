from __future__ import annotations

from dataclasses import replace
from functools import partial
from importlib.metadata import version
from importlib.util import find_spec
from typing import Any

from pydantic import Field

from pointkit.geometry.cloud import Floats, PointCloud
from pointkit.measurement import CostlyResult
from puckbench.codecs.base import CloudKind
from puckbench.codecs.gpcc import CoderOptions, Gpcc
from puckbench.codecs.registry import CODECS
from puckbench.geometry.jet_smoothing import LEAST_NEIGHBOURS, smooth_by_jets

CODE = ("puckbench.codecs.gpcc", "puckbench.geometry.jet_smoothing")


class DenoisedOptions(CoderOptions):
    neighbours: int = Field(
        45,
        ge=LEAST_NEIGHBOURS,
        description="number of neighbours to which a surface is fitted at each point",
    )


@CODECS.register("gpcc_denoised")
class GpccDenoised(Gpcc):
    """The codec smooths points by fitting jets with CGAL, and then encodes them with `gpcc`.

    Streams have the format of `gpcc`. Jets are quadrics fitted to the nearest neighbours (Cazals
    and Pouget 2005), a moving-least-squares method. The default number of neighbours was chosen
    from 20 to 300 on three generated rooms with the error model `vlp16_divergence`.
    """

    Options = DenoisedOptions
    options: DenoisedOptions
    estimates = True

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        if find_spec("CGAL"):
            self.version = f"{self.version}, CGAL {version('cgal')}"

    def skip(self, cloud: CloudKind, rate: str) -> str | None:
        missing = "CGAL (GPL-3.0) not installed: pip install 'puckbench[denoise]'"
        return super().skip(cloud, rate) or (None if find_spec("CGAL") else missing)

    def prepare(self, cloud: PointCloud) -> CostlyResult[Floats]:
        return CostlyResult()

    def encode(
        self, cloud: PointCloud, rate: str, work: CostlyResult[Floats] | None = None
    ) -> bytes:
        work = self.prepare(cloud) if work is None else work
        denoised = work.of(cloud.xyz.tobytes(), partial(self._denoised, cloud.xyz))
        return super().encode(replace(cloud, xyz=denoised), rate)

    def _denoised(self, points: Floats) -> Floats:
        return smooth_by_jets(points, self.options.neighbours)
