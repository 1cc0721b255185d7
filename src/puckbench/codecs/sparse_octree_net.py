"""The codec `sparse_octree_net`: a neural network predicts the occupancy of octree nodes.

Points are rounded to a grid and compressed losslessly. A rate is the scale of the grid or, for
clouds in metres, its step. Decoded points are those of `gpcc` with merged duplicates.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import Field

from gpcc.grid import input_grid
from pointkit.geometry.cloud import Floats, PointCloud
from puckbench.codecs.base import CloudKind
from puckbench.codecs.gpcc import EIGHTHS, UnitOptions, finest_step
from puckbench.codecs.learned import Learned, LearnedOptions
from puckbench.codecs.rates import Parameters, grid_fault, lengths, parameters_of
from puckbench.codecs.registry import CODECS

if TYPE_CHECKING:
    from pcc_networks.octree_net.weights import OctreeNetWeights

CODE = (
    "puckbench.codecs.gpcc",
    "pcc_networks",
    "pcc_networks.octree_net",
    "pcc_networks.sparse",
    "puckbench.codecs.learned",
)


_MOST_STEPS = float(2**20 - 2)
"""Largest extent along an axis, in steps of the grid."""


class OctreeNetOptions(LearnedOptions, UnitOptions):
    weights: str = Field(
        "sparse_octree_net_rooms", description="a shipped set's name, a file, or a folder"
    )


@CODECS.register("sparse_octree_net")
class SparseOctreeNet(Learned["OctreeNetWeights"]):
    """The codec is a learned octree coder, lossless on its grid."""

    rates: Mapping[str, Parameters] = {**EIGHTHS, **lengths()}
    any_scale = True
    Options: type[OctreeNetOptions] = OctreeNetOptions
    options: OctreeNetOptions
    magic = b"PBON"
    training = "pcc_networks.training:OctreeNetTraining"
    version = "sparse_octree_net, stream version 3"
    network = "sparse_octree_net"

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.grid = finest_step(self)

    def skip(self, cloud: CloudKind, rate: str) -> str | None:
        most_m = _MOST_STEPS * parameters_of(self, rate).get("step_m", math.inf)
        return (
            grid_fault(self, cloud.frame, rate)
            or cloud.wider_than(most_m)
            or super().skip(cloud, rate)
        )

    def load(self) -> None:
        self._try([{"scale": 1}])

    def encode_points(self, points: Floats, parameters: Parameters) -> bytes:
        from pcc_networks.octree_net.codec import encode

        scale = float(parameters.get("scale", 1.0))
        grid = input_grid(points, float(parameters.get("step_m", self.options.step)), scale)
        return encode(points, self.weights_of(parameters), scale, grid)

    def decode(self, stream: bytes) -> PointCloud:
        from pcc_networks.octree_net.codec import decode
        from pcc_networks.octree_net.stream import read_stream

        return PointCloud(decode(stream, self.weights_with(read_stream(stream).digest)))

    def read_weights(self, path: Path) -> OctreeNetWeights:
        from pcc_networks.octree_net.weights import load_weights

        return load_weights(path)
