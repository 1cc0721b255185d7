"""The codec RENO as published, for clouds in metres on grids with power-of-two steps.

The authors' parameter posQ is the step in mm. The encoder takes coordinates in mm, relative to a
corner at -131,072 mm on each axis. It divides them by posQ and rounds to integers, halves to even.
Except where halves are rounded, decoded points are those of `gpcc` with merged duplicates at the
same step.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from pydantic import Field

from pointkit.geometry.cloud import Floats
from puckbench.codecs.base import Line, Memory, Pace, Parameters, lengths
from puckbench.codecs.learned import Learned, LearnedOptions
from puckbench.codecs.registry import CODECS

if TYPE_CHECKING:
    from pcc_networks.reno.weights import RenoWeights

CODE = ("pcc_networks", "pcc_networks.reno", "pcc_networks.sparse", "puckbench.codecs.learned")

PUBLISHED_WEIGHTS = "data/reno_weights"
"""Folder to which `puckbench data reno_weights` writes the weights of RENO's authors."""
_MM = 0.001
_OFFSET = 131072
"""Distance along each axis from the corner of the authors' grid to the origin, mm."""


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

    title = "RENO"
    use = "turns of spinning sensors, as its authors published it"
    colour = "#1F78B4"
    marker = "1"
    line: Line = "--"
    rank = 125
    metric_rates = lengths(512, 256, 128, 64, 32, 16, 8, 4)
    Options: type[RenoOptions] = RenoOptions
    options: RenoOptions
    magic = b"RENO"
    any_length = False
    most_steps = float(2**20 - 2)
    memory = Memory(1000, 1500)
    pace = Pace(0.3, 12.0)
    version = "RENO, stream version 1"
    network = "reno"
    published_weights = PUBLISHED_WEIGHTS

    def load(self) -> None:
        corner = np.stack(np.meshgrid(*[np.arange(12.0)] * 3), axis=-1).reshape(-1, 3)
        self._decode(self._encode(corner, {"step_m": 1.024}))

    def most_extent(self, rate: str) -> float:
        """Return the largest extent of a cloud at a rate, in m, less twice the grid's offset."""
        return super().most_extent(rate) - 2 * _OFFSET * _MM

    def _path(self, parameters: Parameters) -> Path | None:
        files, name = self._files(), self.options.trained_on
        is_file = Path(self.options.weights).is_file()
        return next((path for path in files if is_file or path.stem == name), None)

    def _encode(self, points: Floats, parameters: Parameters) -> bytes:
        from pcc_networks.reno.codec import encode

        posq = round(float(parameters["step_m"]) / _MM, 6)
        return encode(points / _MM, self._weights(parameters), posq)

    def _decode(self, stream: bytes) -> Floats:
        from pcc_networks.reno.codec import decode
        from pcc_networks.reno.stream import read_stream

        return decode(stream, self._made_with(read_stream(stream).digest)) * _MM

    def _read(self, path: Path) -> RenoWeights:
        from pcc_networks.reno.weights import load_weights

        return load_weights(path)
