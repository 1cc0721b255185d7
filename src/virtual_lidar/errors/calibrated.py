from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

import numpy as np
from pydantic import NonNegativeFloat, NonNegativeInt, model_validator

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from pointkit.lidar.sensor import Sensor
from pointkit.models import parsed
from pointkit.seeding import generator
from pointkit.yaml_files import read_yaml
from virtual_lidar.errors.model import (
    ERROR_MODELS,
    Distribution,
    Draws,
    ErrorModel,
    Hits,
    standard_noise,
)

FORMAT = "puckbench range error model 1"
_SHIPPED = Path(__file__).parent / "calibrations"
_NOT_IN_FILES = {"file", "device"}


@ERROR_MODELS.register("calibrated")
class Calibrated(ErrorModel):
    """Error model with the range noise that `virtual_lidar.calibrate` estimates from a sensor.

    A measured range is ``d + range_mean_m + b1 + b2 + b3 + noise`` for the true range d. The biases
    b1, b2 and b3 are drawn for each laser: b1 once for a device (`laser_sigma_m`), b2 once for a
    scan (`scan_sigma_m`), and b3 for every frame (`frame_sigma_m`). The noise is drawn for every
    ray, with the standard deviation ``ray_sigma_m + ray_incidence_m theta^2 + ray_range d`` at the
    incidence theta (rad). There, d and theta outside of the calibrated domain are replaced by its
    nearest values.
    """

    file: str | None = None
    """Path of a file of `write_calibration`, or name of one in this package, such as
    ``vlp16_measured``; other parameters that are given override the file's."""
    device: NonNegativeInt | None = None
    """0 is the measured device (`bias_m`); n > 0 is a simulated device, whose biases, drawn from
    ``N(0, laser_sigma_m)``, are equal in all scans. The default is the measured device or, without
    `bias_m`, a new simulated device in each scan."""
    bias_m: tuple[float, ...] | None = None
    """Biases of the measured device by laser id, relative to their mean."""
    laser_sigma_m: NonNegativeFloat = 0.0
    """Standard deviation of the biases of a device's lasers."""
    scan_sigma_m: NonNegativeFloat = 0.0
    """Standard deviation of the biases that are drawn for each scan."""
    frame_sigma_m: NonNegativeFloat = 0.0
    """Standard deviation of the biases that are drawn for each frame."""
    ray_sigma_m: NonNegativeFloat
    """Coefficient of the ray noise, m."""
    ray_incidence_m: float = 0.0
    """Coefficient of the ray noise, m per rad^2."""
    ray_range: float = 0.0
    """Coefficient of the ray noise, m per m."""
    range_mean_m: float = 0.0
    """Mean error of all lasers."""
    ray_distribution: Distribution = "gaussian"
    """``gaussian`` or ``laplace``, both with the standard deviation of the ray noise."""
    most_incidence_rad: NonNegativeFloat | None = None
    """Largest incidence of the calibrated domain."""
    ranges_m: tuple[float, ...] | None = None
    """Shortest and longest range of the calibrated domain."""

    @model_validator(mode="before")
    @classmethod
    def _with_those_of_its_file(cls, values: dict[str, Any]) -> dict[str, Any]:
        parameters = {name: value for name, value in values.items() if value is not None}
        file = values.get("file", cls.model_fields["file"].default)
        parameters["file"] = file
        if isinstance(file, str):
            parameters = {**read_parameters(file), **parameters}
        if "ray_sigma_m" not in parameters:
            raise InputError("set file, or ray_sigma_m and all other parameters that are not zero")
        return parameters

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.ranges_m is not None and (
            len(self.ranges_m) != 2 or not 0 <= self.ranges_m[0] <= self.ranges_m[1]
        ):
            raise InputError("ranges_m must be the shortest and the longest range, m")
        if self.device == 0 and self.bias_m is None:
            raise InputError("device is 0, but bias_m of a measured device is not given")
        return self

    def perturb_ranges(self, hits: Hits, sensor: Sensor, draws: Draws) -> Floats:
        noisy = standard_noise(draws.running("ray"), hits.distance.shape, self.ray_distribution)
        is_laplace = self.ray_distribution == "laplace"
        noisy *= self._ray_sigma(hits) * (np.sqrt(0.5) if is_laplace else 1.0)
        noisy += self._bias(len(hits.distance), sensor, draws)[:, None, :]
        noisy += self.range_mean_m + hits.distance
        return noisy

    def _ray_sigma(self, hits: Hits) -> Floats:
        low, high = self.ranges_m or (0.0, np.inf)
        angle = np.minimum(np.nan_to_num(hits.incidence), self.most_incidence_rad or np.pi / 2)
        far = np.clip(np.where(np.isfinite(hits.distance), hits.distance, low), low, high)
        sigma = self.ray_sigma_m + self.ray_incidence_m * angle**2
        return np.maximum(sigma + self.ray_range * far, 0.0)

    def _bias(self, frames: int, sensor: Sensor, draws: Draws) -> Floats:
        lasers = sensor.lasers
        fixed = self._device(lasers, draws)
        fixed += draws.fixed("scan").standard_normal(lasers) * self.scan_sigma_m
        frame = draws.running("frame").standard_normal((frames, lasers))
        return np.asarray(fixed + frame * self.frame_sigma_m)

    def _device(self, lasers: int, draws: Draws) -> Floats:
        another = self.device is not None and self.device > 0
        stream = generator(self.device or 0, "device") if another else draws.fixed("device")
        biases = stream.standard_normal(lasers) * self.laser_sigma_m
        if self.bias_m is not None and not another:
            if len(self.bias_m) > lasers:
                raise InputError(f"bias_m has {len(self.bias_m)} lasers, the sensor {lasers}")
            biases[: len(self.bias_m)] = self.bias_m
        return np.asarray(biases)


def read_parameters(file: str) -> dict[str, Any]:
    """Return the parameters of `Calibrated`, by name, from a file that `write_calibration` made.

    Parameters
    ----------
    file
        A path that ends in .yaml or .yml, or the name of a file in this package, such as
        ``vlp16_measured``.

    Raises
    ------
    InputError
        The file is missing or was not made by `write_calibration`.
    """
    path = Path(file)
    path = path if path.suffix in {".yaml", ".yml"} else _SHIPPED / f"{file}.yaml"
    content = read_yaml(path)
    if not isinstance(content, Mapping) or content.get("format") != FORMAT:
        raise InputError(f"{path}: not a model file of puckbench calibrate (format: {FORMAT})")
    parameters = content.get("parameters")
    if not isinstance(parameters, Mapping) or "ray_sigma_m" not in parameters:
        raise InputError(f"{path}: no parameters, or no ray_sigma_m among them")
    if outside := _NOT_IN_FILES & set(parameters):
        raise InputError(f"{path}: unknown parameter {outside.pop()!r}")
    read = parsed(Calibrated, parameters, str(path))
    return {name: getattr(read, name) for name in Calibrated.model_fields if name in parameters}
