"""Range noise as it was calibrated: a parameter file of `puckbench calibrate`, or the values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from puckbench.core.errors import InputError
from puckbench.core.files import read_bytes
from puckbench.core.seeding import generator
from puckbench.geometry.cloud import Floats
from puckbench.lidar.errors.model import Draws, Hits
from puckbench.lidar.errors.noise import check_distributions, standard_noise
from puckbench.lidar.options import check_at_least, from_options
from puckbench.lidar.sensor import Sensor
from puckbench.lidar.sweep import Rays

FORMAT = "puckbench range error model 1"
_SHIPPED = Path(__file__).parent / "calibrations"
_NOT_IN_FILES = {"file", "device"}


@dataclass(frozen=True)
class Calibrated:
    """``d + range_mean_m + laser bias + scan bias + frame bias + ray noise``.

    file: a model file, or the name of one that is shipped; what it holds stands in for every
    parameter that is not given (None).

    The bias of a laser belongs to the device. device: 0 is the one that was measured, whose biases
    are `bias_m` (m, one per laser id, about their mean); n > 0 is the n-th of others, drawn from
    ``N(0, laser_sigma_m)`` and the same in every scan; None is the measured one where its biases
    are known, and otherwise another device in every scan. A bias of `scan_sigma_m` is redrawn for
    every scan and laser, one of `frame_sigma_m` for every frame and laser.

    A ray's noise has the standard deviation ``ray_sigma_m + ray_incidence_m theta^2 + ray_range
    d``, m, with the incidence theta (rad) and the distance d (m) taken no further than they were
    calibrated: `most_incidence_rad` and `ranges_m`, shortest and longest. All sigmas are standard
    deviations, for Laplace noise too.
    """

    file: str | None = None
    device: int | None = None
    bias_m: tuple[float, ...] | None = None
    laser_sigma_m: float | None = None
    scan_sigma_m: float | None = None
    frame_sigma_m: float | None = None
    ray_sigma_m: float | None = None
    ray_incidence_m: float | None = None
    ray_range: float | None = None
    range_mean_m: float | None = None
    ray_distribution: str | None = None
    most_incidence_rad: float | None = None
    ranges_m: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        stored = {} if self.file is None else read_parameters(self.file)
        for name, value in {**_DEFAULTS, **stored}.items():
            if getattr(self, name) is None:
                object.__setattr__(self, name, value)
        if self.ray_sigma_m is None:
            raise InputError("needs a model file, or ray_sigma_m and what else is not zero")
        check_at_least(self, 0, "laser_sigma_m", "scan_sigma_m", "frame_sigma_m", "device")
        check_at_least(self, 0, "ray_sigma_m", "most_incidence_rad")
        check_distributions(self, "ray_distribution")
        if self.ranges_m is not None and (
            len(self.ranges_m) != 2 or not 0 <= self.ranges_m[0] <= self.ranges_m[1]
        ):
            raise InputError("ranges_m must be the shortest and the longest range, m")
        if self.device == 0 and self.bias_m is None:
            raise InputError("device is 0, but bias_m of a measured device is not given")

    def perturb_rays(self, rays: Rays, sensor: Sensor, draws: Draws) -> Rays:
        """The nominal rays."""
        return rays

    def perturb_ranges(self, hits: Hits, sensor: Sensor, draws: Draws) -> Floats:
        """True distance plus the biases of its laser plus the noise of its ray."""
        distribution, shape = self.ray_distribution or "gaussian", hits.distance.shape
        noisy = standard_noise(draws.running("ray"), shape, distribution)
        noisy *= self._ray_sigma(hits) * (np.sqrt(0.5) if distribution == "laplace" else 1.0)
        noisy += self._bias(len(hits.distance), sensor, draws)[:, None, :]
        noisy += (self.range_mean_m or 0.0) + hits.distance
        return noisy

    def _ray_sigma(self, hits: Hits) -> Floats:
        """Standard deviation of each ray's noise, m, finite for a miss too."""
        low, high = self.ranges_m or (0.0, np.inf)
        angle = np.minimum(np.nan_to_num(hits.incidence), self.most_incidence_rad or np.pi / 2)
        far = np.clip(np.where(np.isfinite(hits.distance), hits.distance, low), low, high)
        sigma = (self.ray_sigma_m or 0.0) + (self.ray_incidence_m or 0.0) * angle**2
        return np.maximum(sigma + (self.ray_range or 0.0) * far, 0.0)

    def _bias(self, frames: int, sensor: Sensor, draws: Draws) -> Floats:
        """Bias of each laser in each frame, m, (frames, lasers)."""
        lasers = sensor.lasers
        fixed = self._device(lasers, draws)
        fixed += draws.fixed("scan").standard_normal(lasers) * (self.scan_sigma_m or 0.0)
        frame = draws.running("frame").standard_normal((frames, lasers))
        return np.asarray(fixed + frame * (self.frame_sigma_m or 0.0))

    def _device(self, lasers: int, draws: Draws) -> Floats:
        """The lasers' own biases, m, (lasers,), of the device that is asked for."""
        another = self.device is not None and self.device > 0
        stream = generator(self.device or 0, "device") if another else draws.fixed("device")
        biases = stream.standard_normal(lasers) * (self.laser_sigma_m or 0.0)
        if self.bias_m is not None and not another:
            if len(self.bias_m) > lasers:
                raise InputError(f"bias_m has {len(self.bias_m)} lasers, the sensor {lasers}")
            biases[: len(self.bias_m)] = self.bias_m
        return np.asarray(biases)


_DEFAULTS: dict[str, Any] = {
    "laser_sigma_m": 0.0,
    "scan_sigma_m": 0.0,
    "frame_sigma_m": 0.0,
    "ray_incidence_m": 0.0,
    "ray_range": 0.0,
    "range_mean_m": 0.0,
    "ray_distribution": "gaussian",
}


def shipped_calibration(name: str) -> Path:
    """Where the model file that is shipped under `name` is."""
    return _SHIPPED / f"{name}.yaml"


def read_parameters(file: str) -> dict[str, Any]:
    """The parameters in a model file, those that it has, as `Calibrated` takes them.

    Raises InputError, one line that names the file, when it is missing or something else.
    """
    path = Path(file)
    path = path if path.suffix in {".yaml", ".yml"} else shipped_calibration(file)
    try:
        content = yaml.safe_load(read_bytes(path))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not valid YAML ({' '.join(str(error).split())})") from error
    if not isinstance(content, Mapping) or content.get("format") != FORMAT:
        raise InputError(f"{path}: not a model file of puckbench calibrate (format: {FORMAT})")
    parameters = content.get("parameters")
    if not isinstance(parameters, Mapping) or "ray_sigma_m" not in parameters:
        raise InputError(f"{path}: no parameters, or no ray_sigma_m among them")
    if outside := _NOT_IN_FILES & set(parameters):
        raise InputError(f"{path}: parameters have {outside.pop()!r}, which is not the device's")
    read = from_options(Calibrated, parameters, str(path))
    return {one.name: getattr(read, one.name) for one in fields(read) if one.name in parameters}
