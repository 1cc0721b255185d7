"""The codecs PCGCv2, as published, and PCGCv2+, puckbench's variant.

PCGCv2 truncates points to voxels, and PCGCv2+ rounds them. Both merge equal voxels. PCGCv2 uses the
grid of the input, which is [0, 1023] in the thesis. The network is made for dense surfaces.
Therefore PCGCv2+ coarsens the grid of a sparse cloud until voxels have a mean of
`mean_occupied_children` occupied children.

A rate's `lmbda` is the Lagrangian weight of the training, and `rho` is the ratio of decoded to
input voxels.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import Field

from pointkit.geometry.cloud import Floats, PointCloud
from puckbench.codecs.base import CloudKind
from puckbench.codecs.learned import Improved, ImprovedOptions, LearnedByLambda
from puckbench.codecs.rates import Parameters, grid_fault
from puckbench.codecs.registry import CODECS

if TYPE_CHECKING:
    from pcc_networks.pcgcv2.stream import CodingTools
    from pcc_networks.pcgcv2.weights import Pcgcv2Weights

CODE = (
    "gpcc.*",
    "pcc_networks",
    "pcc_networks.pcgcv2",
    "pcc_networks.sparse",
    "puckbench.codecs.learned",
)


@CODECS.register("pcgcv2")
class Pcgcv2(LearnedByLambda["Pcgcv2Weights"]):
    """The codec is the learned PCGCv2 as published (Wang, Ding, Li, Ma 2021).

    The decoder keeps the most probable voxels of the whole cloud, so sparse parts may vanish.
    """

    rates: Mapping[str, Parameters] = {
        "r1": {"lmbda": 0.25},
        "r2": {"lmbda": 0.5},
        "r3": {"lmbda": 1},
        "r4": {"lmbda": 2},
        "r5": {"lmbda": 4},
        "r6": {"lmbda": 6},
        "r7": {"lmbda": 10},
    }
    magic = b"PCG2"
    training = "pcc_networks.training:Pcgcv2Training"
    version = "PCGCv2, stream version 6"
    network = "pcgcv2"
    grid = 1.0

    def skip(self, cloud: CloudKind, rate: str) -> str | None:
        return grid_fault(self, cloud.frame, rate) or super().skip(cloud, rate)

    def _tools(self) -> CodingTools:
        """Return the coding tools that this codec uses and the authors' program lacks."""
        from pcc_networks.pcgcv2.stream import CodingTools

        return CodingTools(0)

    def encode_points(self, points: Floats, parameters: Parameters) -> bytes:
        from pcc_networks.pcgcv2.codec import encode

        weights, rate = self._numbered(parameters)
        return encode(
            self._as_read(points),
            weights,
            rate,
            rho=float(parameters.get("rho", 1)),
            tools=self._tools(),
            point_reconstruction=self.point_reconstruction,
            **self._grid(parameters),
        )

    def decode(self, stream: bytes) -> PointCloud:
        from pcc_networks.pcgcv2.codec import decode
        from pcc_networks.pcgcv2.stream import Pcgcv2Stream, read_stream

        coded = read_stream(stream)
        if not isinstance(coded, Pcgcv2Stream):
            return PointCloud(coded)
        return PointCloud(decode(stream, self._of_rate(coded.digest, coded.rate)))

    def read_weights(self, path: Path) -> Pcgcv2Weights:
        from pcc_networks.pcgcv2.weights import load_weights

        return load_weights(path, self.options.device)


class Pcgcv2PlusOptions(ImprovedOptions):
    weights: str = Field("pcgcv2_objects", description="a shipped set's name, a file, or a folder")


@CODECS.register("pcgcv2_plus")
class Pcgcv2Plus(Improved["Pcgcv2Weights"], Pcgcv2):
    """The codec is PCGCv2 with puckbench's grids, context mixing, reconstruction and weights.

    As many points are reconstructed as were encoded. The decoder always keeps the most probable
    child of each voxel, so no part of a cloud vanishes.
    """

    rates: Mapping[str, Parameters] = {
        "r1": {"lmbda": 1, "mean_occupied_children": 2.5, "grid_level_offset": 1.5},
        "r2": {"lmbda": 1, "mean_occupied_children": 2.5, "grid_level_offset": 1},
        "r3": {"lmbda": 1, "mean_occupied_children": 2.5, "grid_level_offset": 0.5},
        "r4": {"lmbda": 1, "mean_occupied_children": 2.5},
        "r5": {"lmbda": 1, "mean_occupied_children": 2.5, "grid_level_offset": -0.5},
        "r6": {"lmbda": 4, "mean_occupied_children": 2.5, "grid_level_offset": -0.5},
        "r7": {"lmbda": 10, "mean_occupied_children": 2.5, "grid_level_offset": -1},
    }
    Options: type[Pcgcv2PlusOptions] = Pcgcv2PlusOptions
    options: Pcgcv2PlusOptions
    version = "PCGCv2+, stream version 6"

    def _tools(self) -> CodingTools:
        from pcc_networks.pcgcv2.stream import CodingTools

        return CodingTools.CHILD_PER_PARENT | (
            CodingTools.CONTEXT_MIXING if self.context_mixing else CodingTools(0)
        )
