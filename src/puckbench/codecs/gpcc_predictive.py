from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Literal

from pydantic import Field

from gpcc.attributes.options import qp_of_step
from puckbench.codecs.gpcc import EIGHTHS, CoderOptions, SensorCodec
from puckbench.codecs.rates import Parameters, lengths
from puckbench.codecs.registry import CODECS

if TYPE_CHECKING:
    from gpcc.predictive_coder import PredictiveOptions

CODE = ("puckbench.codecs.gpcc",)

_LEAST_QP = 58


class TreeOptions(CoderOptions):
    duplicates: Literal["merged", "kept", "by_rate"] = "kept"
    order: Literal["given", "morton", "azimuth", "radius"] = Field(
        "azimuth", description="order of the points in trees"
    )


def _coarse(radius_log2: int, azimuth_log2: int) -> dict[str, Parameters]:
    steps = {"radius_inv_scale_log2": radius_log2, "azimuth_scale_log2": azimuth_log2}
    return {f"{1 << radius_log2}mm": {"step_m": 0.001, **steps}}


@CODECS.register("gpcc_predictive")
class GpccPredictive(SensorCodec):
    """The codec is G-PCC's predictive geometry, in spherical coordinates if the cloud has returns.

    For clouds in metres, points are first rounded to 1 mm at rates of 4 mm or more. The rate is
    then the step of the radius or, without returns, of x, y and z. Rates of 2 mm and 1 mm are steps
    of a grid that is encoded losslessly.
    """

    rates: Mapping[str, Parameters] = {
        **EIGHTHS,
        **_coarse(7, 7),
        **_coarse(5, 8),
        **_coarse(4, 9),
        **_coarse(2, 11),
        **lengths(2, 1),
    }
    along_rays = True
    Options = TreeOptions
    options: TreeOptions

    def _qp(self, parameters: Parameters) -> int | None:
        if "qp" not in parameters and (radius_log2 := parameters.get("radius_inv_scale_log2")):
            return qp_of_step(float(parameters["step_m"]) * 2.0**radius_log2)
        return super()._qp(parameters)

    def _tools(self, parameters: Parameters, *, angular: bool = False) -> PredictiveOptions:
        from gpcc.predictive_coder import PredictiveOptions

        steps: dict[str, Any] = {
            key: value for key, value in parameters.items() if key.endswith("_log2")
        }
        radius_log2 = steps.get("radius_inv_scale_log2", 0)
        if radius_log2 and angular:  # errors of the radius stay below half this step
            steps["base_qp"] = max(_LEAST_QP, 8 * radius_log2 + 2)
        elif radius_log2:
            steps["base_qp"] = 8 * radius_log2
        merged = self._merges(parameters)
        return PredictiveOptions(order=self.options.order, merge_duplicates=merged, **steps)
