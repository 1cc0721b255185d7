"""The codec Inter-LPCM as published, each turn alone.

The published program also predicts radii of the eight uppermost lines from the preceding turn.
`pcc_networks.inter_lpcm` does so, too; a codec of puckbench has one cloud per call.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import Field

from pointkit.geometry.cloud import Floats, PointCloud
from puckbench.codecs.base import CloudKind
from puckbench.codecs.learned import Learned, LearnedOptions
from puckbench.codecs.rates import Parameters, lengths, parameters_of
from puckbench.codecs.registry import CODECS

if TYPE_CHECKING:
    from pcc_networks.inter_lpcm.weights import LpcmWeights

CODE = ("pcc_networks", "pcc_networks.inter_lpcm", "puckbench.codecs.learned")

_MOST_EXTENT = 350.0
"""Largest extent of a cloud, m: distances from point to point along a line are 496 m at most."""
_MOST_STEPS = 30_000
"""Largest extent of a cloud in steps of the corrections."""


class InterLpcmOptions(LearnedOptions):
    weights: str = Field("", description="archive (.zip) of the authors' repository")


@CODECS.register("inter_lpcm")
class InterLpcm(Learned["LpcmWeights"]):
    """The codec is Inter-LPCM as published (Sun, Yuan, Jiang, Tian, Zhang, Hamzaoui 2026).

    It uses the weights of its authors, and codes each turn alone. The rate is the step of the
    corrections that follow the spherical coordinates; their program has 20 mm. All points are kept,
    in their order.
    """

    rates: Mapping[str, Parameters] = lengths(100, 50, 20)
    Options: type[InterLpcmOptions] = InterLpcmOptions
    options: InterLpcmOptions
    magic = b"LPCM"
    version = "Inter-LPCM, stream version 1"
    network = "inter_lpcm"

    def load(self) -> None:
        self._try(list(self.rates.values())[:1])

    def skip(self, cloud: CloudKind, rate: str) -> str | None:
        step = float(parameters_of(self, rate)["step_m"])
        most = min(_MOST_EXTENT, _MOST_STEPS * step)
        return cloud.wider_than(most) or super().skip(cloud, rate)

    def encode_points(self, points: Floats, parameters: Parameters) -> bytes:
        from pcc_networks.inter_lpcm.codec import encode

        return encode(points, self.weights_of(parameters), float(parameters["step_m"]))

    def decode(self, stream: bytes) -> PointCloud:
        from pcc_networks.inter_lpcm.codec import decode
        from pcc_networks.inter_lpcm.stream import read_stream

        weights = self.weights_with(read_stream(stream).digest)
        return PointCloud(decode(stream, weights).points)

    def read_weights(self, path: Path) -> LpcmWeights:
        from pcc_networks.inter_lpcm.weights import load_weights

        return load_weights(path)
