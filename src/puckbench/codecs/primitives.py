"""The codec `primitives`, which fits planes, surfaces of revolution and voxels to the points."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from pointkit.geometry.cloud import Floats
from pointkit.geometry.mesh import Mesh
from pointkit.models import Model, parsed
from primitive_codec.settings import RATES, PrimitiveSettings
from puckbench.codecs.base import Codec, Pace, Parameters
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

    title = "Primitives"
    use = "noisy scans; meshes; the fewest bits"
    colour = "#CC79A7"
    marker = "P"
    rank = 40
    pace = Pace(0.7, 10.0, encoding=0.9)
    rates: Mapping[str, Parameters] = RATES
    Options: type[PrimitivesOptions] = PrimitivesOptions
    options: PrimitivesOptions
    magic = b"PBPR"
    surfaces = True
    version = "9"

    def load(self) -> None:
        from primitive_codec.mode_decision import encode

        rng = np.random.default_rng(0)
        turn = 2 * np.pi * rng.random(1000)
        column = np.column_stack([0.2 * np.cos(turn), 0.2 * np.sin(turn), 0.6 * rng.random(1000)])
        floor = np.column_stack([rng.random((1000, 2)) - 0.5, np.zeros(1000)])
        points = np.concatenate([column, floor]) + rng.normal(0, 0.001, (2000, 3))
        self._decode(encode(points, PrimitiveSettings(**self._MOST)))

    _MOST: ClassVar[Parameters] = {**RATES["r3"], "refinement": 1, "max_voxel_size": 16}

    def shared_work(self) -> SurfaceCache | None:
        """Return a new cache for the fitted surface, which all rates of one cloud share.

        Return None if a subclass overrides `_encode`, which does not receive the cache.
        """
        from primitive_codec.mode_decision import SurfaceCache

        return SurfaceCache() if type(self)._encode is Primitives._encode else None

    def _encode(self, points: Floats, parameters: Parameters) -> bytes:
        return self._encode_sharing(points, parameters, None)

    def _encode_sharing(
        self, points: Floats, parameters: Parameters, shared: SurfaceCache | None
    ) -> bytes:
        from primitive_codec.mode_decision import encode

        settings = parsed(PrimitiveSettings, parameters, "codec primitives: rate")
        return encode(points, settings, shared)

    def _decode_mesh(self, stream: bytes) -> Mesh:
        from primitive_codec.mesh_reconstruction import decode_mesh

        return decode_mesh(stream)

    def _decode(self, stream: bytes) -> Floats:
        from primitive_codec.decoder import decode

        return decode(stream)
