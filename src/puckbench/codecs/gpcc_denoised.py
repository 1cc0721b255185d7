from __future__ import annotations

from functools import partial
from importlib.metadata import version
from typing import Any, ClassVar

from pydantic import Field

from pointkit.geometry.cloud import Floats
from pointkit.measurement import CostlyResult
from puckbench.codecs.base import Availability, Pace, Parameters
from puckbench.codecs.gpcc import CoderOptions, Gpcc
from puckbench.codecs.registry import CODECS
from puckbench.geometry.attributes import Attributes
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

    title = "Denoised, then G-PCC"
    use = "comparison with codecs whose decoded scans are nearer to the surface"
    colour = "#999933"
    marker = "h"
    line = "-."
    rank = 72
    pace = Pace(0.5, 30.0, encoding=0.95)
    Options = DenoisedOptions
    options: DenoisedOptions
    estimates: ClassVar[bool] = True

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        if self.available().ok:
            self.version = f"{self.version}, CGAL {version('cgal')}"

    def available(self) -> Availability:
        why = "CGAL (GPL-3.0) not installed: pip install 'puckbench[denoise]'"
        return Availability.of_module("CGAL", why)

    def shared_work(self) -> CostlyResult[Floats]:
        return CostlyResult()

    def _encode_with_attributes(
        self, points: Floats, attributes: Attributes, parameters: Parameters
    ) -> bytes:
        return super()._encode_with_attributes(self._denoised(points), attributes, parameters)

    def _encode(self, points: Floats, parameters: Parameters) -> bytes:
        return super()._encode(self._denoised(points), parameters)

    def _encode_sharing(
        self, points: Floats, parameters: Parameters, shared: CostlyResult[Floats]
    ) -> bytes:
        denoised = shared.of(points.tobytes(), partial(self._denoised, points))
        return super()._encode(denoised, parameters)

    def _denoised(self, points: Floats) -> Floats:
        return smooth_by_jets(points, self.options.neighbours)
