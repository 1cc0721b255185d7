from __future__ import annotations

from pydantic import NonNegativeFloat

from virtual_lidar.errors.calibrated import Calibrated
from virtual_lidar.errors.model import ERROR_MODELS
from virtual_lidar.errors.vlp16 import Vlp16

CODE = ("virtual_lidar.errors.vlp16", "virtual_lidar.errors.calibrated")


@ERROR_MODELS.register("vlp16_table51")
class Vlp16Table51(Vlp16):
    """Error model `Vlp16` with the sigmas of the thesis's Table 5.1."""

    title, colour, variant_of = "VLP-16, Table\u00a05.1", "#9988BB", Vlp16

    bias_sigma_m: NonNegativeFloat = 0.078
    ray_sigma_m: NonNegativeFloat = 0.014


@ERROR_MODELS.register("hdl64e")
class Hdl64e(Vlp16):
    """Error model `Vlp16` with BlenSor's default sigmas, which are for the HDL-64E."""

    title, colour, variant_of = "HDL-64E", "#77CCDD", Vlp16

    bias_sigma_m: NonNegativeFloat = 0.078


@ERROR_MODELS.register("thesis_room")
class ThesisRoom(Vlp16):
    """Error model `Vlp16` with the ray noise of the thesis's room scans (sigma 20 mm)."""

    title, colour, variant_of = "Thesis, rooms", "#005533", Vlp16

    ray_sigma_m: NonNegativeFloat = 0.020


@ERROR_MODELS.register("vlp16_measured")
class Vlp16Measured(Calibrated):
    """Error model `Calibrated` with the parameters of two real VLP-16 (vlp16_measured.yaml)."""

    title, colour, variant_of = "Measured", "#CC7700", Calibrated

    file: str | None = "vlp16_measured"
