"""The codec `primitives`, which fits planes, surfaces of revolution and voxels to the points."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from pointkit.geometry.cloud import PointCloud
from pointkit.geometry.mesh import Mesh
from pointkit.models import Model, parsed
from primitive_codec.settings import RATES, PrimitiveSettings
from puckbench.codecs.base import Codec
from puckbench.codecs.rates import Parameters, parameters_of
from puckbench.codecs.registry import CODECS

if TYPE_CHECKING:
    from primitive_codec.mode_decision import SurfaceCache

CODE = ("gpcc.*", "primitive_codec.*")


class PrimitivesOptions(Model):
    unit: float | None = Field(
        None,
        gt=0,
        description="any length makes the codec code clouds in metres too, at the same rates, "
        "which are shares of a cloud's extent",
    )


@CODECS.register("primitives")
class Primitives(Codec):
    """The codec encodes geometric primitives that are fitted to noisy points on surfaces.

    A rate contains the values of `PrimitiveSettings` that differ from the defaults. The unit of
    length is 1/1023 of the cloud's longest side, as in a cloud scaled to [0, 1023].
    """

    rates: Mapping[str, Parameters] = RATES
    Options: type[PrimitivesOptions] = PrimitivesOptions
    options: PrimitivesOptions
    magic = b"PBPR"
    version = "9"

    def load(self) -> None:
        from primitive_codec.mode_decision import encode

        rng = np.random.default_rng(0)
        turn = 2 * np.pi * rng.random(1000)
        column = np.column_stack([0.2 * np.cos(turn), 0.2 * np.sin(turn), 0.6 * rng.random(1000)])
        floor = np.column_stack([rng.random((1000, 2)) - 0.5, np.zeros(1000)])
        points = np.concatenate([column, floor]) + rng.normal(0, 0.001, (2000, 3))
        self.decode(encode(points, PrimitiveSettings(**self._MOST)))

    _MOST: ClassVar[Parameters] = {**RATES["r3"], "refinement": 1, "max_voxel_size": 16}

    def prepare(self, cloud: PointCloud) -> SurfaceCache:
        from primitive_codec.mode_decision import SurfaceCache

        return SurfaceCache()

    def encode(self, cloud: PointCloud, rate: str, work: SurfaceCache | None = None) -> bytes:
        from primitive_codec.mode_decision import encode

        parameters = parameters_of(self, rate)
        settings = parsed(PrimitiveSettings, parameters, "codec primitives: rate")
        return encode(cloud.xyz, settings, work)

    def decode(self, stream: bytes) -> PointCloud:
        from primitive_codec.decoder import decode

        return PointCloud(decode(stream))

    def surfaces(self, stream: bytes) -> Mesh:
        from primitive_codec.mesh_reconstruction import decode_mesh

        return decode_mesh(stream)
