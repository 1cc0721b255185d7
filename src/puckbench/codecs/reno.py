"""The codec RENO as published, for clouds in metres on grids with power-of-two steps.

The authors' parameter posQ is the step in mm. The encoder takes coordinates in mm, relative to a
corner at -131,072 mm on each axis. It divides them by posQ and rounds to integers, halves to even.
Except where halves are rounded, decoded points are those of `gpcc` with merged duplicates at the
same step.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from pydantic import Field

from pointkit.geometry.cloud import Floats, PointCloud
from puckbench.codecs.base import CloudKind
from puckbench.codecs.learned import Learned, LearnedOptions
from puckbench.codecs.rates import Parameters, parameters_of
from puckbench.codecs.registry import CODECS

if TYPE_CHECKING:
    from pcc_networks.reno.weights import RenoWeights

CODE = ("pcc_networks", "pcc_networks.reno", "pcc_networks.sparse", "puckbench.codecs.learned")

PUBLISHED_WEIGHTS = "data/reno_weights"
"""Folder to which `puckbench data reno_weights` writes the weights of RENO's authors."""
_MM = 0.001
_OFFSET = 131072
"""Distance along each axis from the corner of the authors' grid to the origin, mm."""
_MOST_STEPS = 2**20 - 2
"""Largest extent along an axis, in steps of the grid."""


class RenoOptions(LearnedOptions):
    weights: str = Field(
        PUBLISHED_WEIGHTS, description="a folder with the authors' weights, or one of their files"
    )
    trained_on: Literal["KITTIDetection", "SemanticKITTI", "Ford"] = Field(
        "KITTIDetection", description="which of the folder's files codes"
    )


@CODECS.register("reno")
class Reno(Learned["RenoWeights"]):
    """The codec is the learned RENO as published (You, Chen, Ding, Asif, Ma 2025).

    It uses the weights of its authors. Rates are values of the authors' parameter posQ, the grid
    step in mm. They are those of the paper, and 4, for which the authors also publish results.
    """

    rates: Mapping[str, Parameters] = {
        f"{posq}mm": {"posq": posq} for posq in (512, 256, 128, 64, 32, 16, 8, 4)
    }
    Options: type[RenoOptions] = RenoOptions
    options: RenoOptions
    magic = b"RENO"
    version = "RENO, stream version 1"
    network = "reno"
    published_weights = PUBLISHED_WEIGHTS

    def load(self) -> None:
        corner = np.stack(np.meshgrid(*[np.arange(12.0)] * 3), axis=-1).reshape(-1, 3)
        self.decode(self.encode_points(corner, {"posq": 1024}))

    def skip(self, cloud: CloudKind, rate: str) -> str | None:
        most_mm = _MOST_STEPS * _posq(parameters_of(self, rate)) - 2 * _OFFSET
        return cloud.wider_than(most_mm * _MM) or super().skip(cloud, rate)

    def _path(self, parameters: Parameters) -> Path | None:
        files, name = self._files(), self.options.trained_on
        is_file = Path(self.options.weights).is_file()
        return next((path for path in files if is_file or path.stem == name), None)

    def encode_points(self, points: Floats, parameters: Parameters) -> bytes:
        from pcc_networks.reno.codec import encode

        return encode(points / _MM, self.weights_of(parameters), _posq(parameters))

    def decode(self, stream: bytes) -> PointCloud:
        from pcc_networks.reno.codec import decode
        from pcc_networks.reno.stream import read_stream

        return PointCloud(decode(stream, self.weights_with(read_stream(stream).digest)) * _MM)

    def read_weights(self, path: Path) -> RenoWeights:
        from pcc_networks.reno.weights import load_weights

        return load_weights(path)


def _posq(parameters: Parameters) -> float:
    """Return the authors' parameter of a rate, which may be given as a step in m instead."""
    if "step_m" in parameters:
        return round(float(parameters["step_m"]) / _MM, 6)
    return float(parameters["posq"])
