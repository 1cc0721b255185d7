"""The codecs PCGCv1, as published, and PCGCv1+, puckbench's variant.

As in PCC Arena's table and the thesis, a rate has three parameters: the Lagrangian weight of the
training (`lmbda`), the number of voxels per unit length (`scale`), and the ratio of decoded to
input voxels (`rho`). The network is made for dense surfaces. Therefore PCGCv1+ coarsens the grid of
a sparse cloud until voxels have a mean of `mean_occupied_children` occupied children.

Cubes with fewer than `min_points` points are dropped. With the option `sparse_cubes`, PCGCv1+'s
default, they are encoded losslessly by the octree coder of `gpcc` instead.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import Field

from pointkit.geometry.cloud import Floats, PointCloud
from puckbench.codecs.base import CloudKind
from puckbench.codecs.learned import Improved, ImprovedOptions, LearnedByLambda, PublishedOptions
from puckbench.codecs.rates import Parameters, grid_fault
from puckbench.codecs.registry import CODECS

if TYPE_CHECKING:
    from pcc_networks.pcgcv1.weights import Pcgcv1Weights

CODE = (
    "gpcc.*",
    "pcc_networks",
    "pcc_networks.pcgcv1",
    "pcc_networks.sparse",
    "puckbench.codecs.learned",
)


class Pcgcv1Options(PublishedOptions):
    min_points: int = Field(
        20, ge=1, description="minimum number of points of a cube that the network codes"
    )
    sparse_cubes: bool = Field(False, description="also code cubes with fewer points, without loss")


@CODECS.register("pcgcv1")
class Pcgcv1(LearnedByLambda["Pcgcv1Weights"]):
    """The codec is the learned PCGCv1 with hyper-prior as published (Wang, Zhu, Liu, Ma 2021)."""

    rates: Mapping[str, Parameters] = {
        "r1": {"lmbda": 0.75, "scale": 0.625, "rho": 1.15},
        "r2": {"lmbda": 0.75, "scale": 1, "rho": 1.15},
        "r3": {"lmbda": 2, "scale": 1, "rho": 1},
        "r4": {"lmbda": 3.5, "scale": 1, "rho": 1},
        "r5": {"lmbda": 6, "scale": 1, "rho": 1},
        "r6": {"lmbda": 10, "scale": 1, "rho": 1},
    }
    Options: type[Pcgcv1Options] = Pcgcv1Options
    options: Pcgcv1Options
    magic = b"PCG1"
    training = "pcc_networks.training:Pcgcv1Training"
    version = "PCGCv1, stream version 4"
    network = "pcgcv1"

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.grid = 1 / max((rate.get("scale", 1) for rate in self.rates.values()), default=1)

    def skip(self, cloud: CloudKind, rate: str) -> str | None:
        return grid_fault(self, cloud.frame, rate) or super().skip(cloud, rate)

    def encode_points(self, points: Floats, parameters: Parameters) -> bytes:
        from pcc_networks.pcgcv1.codec import encode

        weights, rate = self._numbered(parameters)
        return encode(
            self._as_read(points),
            weights,
            rate,
            scale=float(parameters.get("scale", 1)),
            rho=float(parameters.get("rho", 1)),
            min_points=self.options.min_points,
            sparse_cubes=self.options.sparse_cubes,
            context_mixing=self.context_mixing,
            point_reconstruction=self.point_reconstruction,
            **self._grid(parameters),
        )

    def decode(self, stream: bytes) -> PointCloud:
        from pcc_networks.pcgcv1.codec import decode
        from pcc_networks.pcgcv1.stream import read_stream

        coded = read_stream(stream)
        return PointCloud(decode(stream, self._of_rate(coded.digest, coded.rate)))

    def read_weights(self, path: Path) -> Pcgcv1Weights:
        from pcc_networks.pcgcv1.weights import load_weights

        return load_weights(path, self.options.device)


class Pcgcv1PlusOptions(ImprovedOptions, Pcgcv1Options):
    weights: str = Field("pcgcv1_mixed", description="a shipped set's name, a file, or a folder")
    sparse_cubes: bool = Field(True, description="also code cubes with fewer points, without loss")


@CODECS.register("pcgcv1_plus")
class Pcgcv1Plus(Improved["Pcgcv1Weights"], Pcgcv1):
    """The codec is PCGCv1 with puckbench's grids, context mixing, reconstruction and weights.

    As many points are reconstructed as were encoded.
    """

    rates: Mapping[str, Parameters] = {
        "r1": {"lmbda": 2, "mean_occupied_children": 2.5, "grid_level_offset": 2.5},
        "r2": {"lmbda": 2, "mean_occupied_children": 2.5, "grid_level_offset": 2},
        "r3": {"lmbda": 2, "mean_occupied_children": 2.5, "grid_level_offset": 1.5},
        "r4": {"lmbda": 2, "mean_occupied_children": 2.5, "grid_level_offset": 1},
        "r5": {"lmbda": 2, "mean_occupied_children": 2.5, "grid_level_offset": 0.5},
        "r6": {"lmbda": 10, "mean_occupied_children": 2.5},
    }
    Options = Pcgcv1PlusOptions
    options: Pcgcv1PlusOptions
    version = "PCGCv1+, stream version 4"
