"""The codec LiZIP as published, for clouds in metres.

The streams contain files of the authors' program in C++, which made their published sizes. Its
grid has a step of 0.01 mm; other rates are those of the program with another constant.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from pydantic import Field

from pointkit.geometry.cloud import Floats, PointCloud
from puckbench.codecs.base import CloudKind
from puckbench.codecs.learned import Learned, LearnedOptions
from puckbench.codecs.rates import LENGTHS_MM, Parameters, lengths, parameters_of
from puckbench.codecs.registry import CODECS

if TYPE_CHECKING:
    from pcc_networks.lizip.weights import LizipWeights

CODE = ("pcc_networks", "pcc_networks.lizip", "pcc_networks.sparse", "puckbench.codecs.learned")

PUBLISHED_WEIGHTS = "data/lizip_weights"
"""Folder to which `puckbench data lizip_weights` writes the weights of LiZIP's authors."""
_MOST_STEPS = 2**31 - 2


class LizipOptions(LearnedOptions):
    weights: str = Field(
        PUBLISHED_WEIGHTS, description="a file of the authors' weights (.bin), or their folder"
    )
    compression: Literal["lzma", "zlib"] = Field(
        "lzma", description="how the differences to the predictions are compressed"
    )


@CODECS.register("lizip")
class Lizip(Learned["LizipWeights"]):
    """The codec is the learned LiZIP as published (Shibu, Karim, Zito 2026).

    It uses the weights of its authors. Points are sorted by cubes of 0.1 m, so that their order is
    lost. A rate is the step to whose multiples coordinates are rounded, in single precision. The
    authors publish results at 0.01 mm.
    """

    rates: Mapping[str, Parameters] = {**lengths(*LENGTHS_MM), "0.01mm": {"step_m": 0.00001}}
    Options: type[LizipOptions] = LizipOptions
    options: LizipOptions
    magic = b"LIZI"
    version = "LiZIP, stream version 1"
    network = "lizip"
    published_weights = PUBLISHED_WEIGHTS

    def skip(self, cloud: CloudKind, rate: str) -> str | None:
        most_m = _MOST_STEPS * float(parameters_of(self, rate)["step_m"])
        return cloud.wider_than(most_m) or super().skip(cloud, rate)

    def encode_points(self, points: Floats, parameters: Parameters) -> bytes:
        from pcc_networks.lizip.codec import encode

        step_m, weights = float(parameters["step_m"]), self.weights_of(parameters)
        return encode(points, weights, step_m, self.options.compression)

    def decode(self, stream: bytes) -> PointCloud:
        from pcc_networks.lizip.codec import decode
        from pcc_networks.lizip.stream import read_stream

        return PointCloud(decode(stream, self.weights_with(read_stream(stream).digest)))

    def read_weights(self, path: Path) -> LizipWeights:
        from pcc_networks.lizip.weights import load_weights

        return load_weights(path)
