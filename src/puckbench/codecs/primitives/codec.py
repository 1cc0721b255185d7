"""The codec `primitives`: surfaces of all sizes, or G-PCC's octree where that is nearer."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from puckbench.codecs.base import Codec, Parameters
from puckbench.codecs.primitives.settings import Settings, settings_of
from puckbench.codecs.primitives.stream import Header, unpack
from puckbench.codecs.registry import CODECS
from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats
from puckbench.geometry.mesh import Mesh


@CODECS.register("primitives")
class Primitives(Codec):
    """Geometric primitives fitted to the cloud, aware of its noise.

    A rate is the values of `Settings` that differ from its defaults; lengths are thousandths
    (1/1023) of the cloud's longest side, the units of the cube [0, 1023].
    """

    title = "Primitives"
    colour = "#CC79A7"
    marker = "P"
    rank = 40
    rates: Mapping[str, Parameters] = {
        "r1": {"leaf": 64, "cell": 32, "largest": 256, "price": 3000, "step": 12, "bpp": 0.1},
        "r2": {"leaf": 32, "cell": 16, "largest": 256, "price": 600, "step": 8, "bpp": 0.2},
        "r3": {"leaf": 16, "cell": 8, "largest": 256, "price": 150, "step": 5, "bpp": 0.4},
        "r4": {"leaf": 16, "cell": 8, "largest": 128, "price": 30, "step": 4, "bpp": 0.7},
        "r5": {"leaf": 8, "cell": 4, "largest": 128, "price": 8, "step": 3, "bpp": 1},
        "r6": {"leaf": 4, "cell": 2, "largest": 128, "price": 3, "step": 1, "bpp": 1.4},
        "r7": {"leaf": 4, "cell": 2, "largest": 64, "price": 0.7, "step": 1, "bpp": 2},
        "r8": {"leaf": 0, "bpp": 3.5, "voxel": 4},
    }
    magic = b"PBPR"
    surfaces = True
    version = "3"

    def load(self) -> None:
        """Compile what encoding and decoding need."""
        from puckbench.codecs.primitives.mode_decision import encode

        rng = np.random.default_rng(0)
        plane = np.column_stack([rng.random((2000, 2)), np.zeros(2000)])
        for settings in (Settings(), Settings(leaf=0.0)):
            self._decode(encode(plane, settings))

    def _encode(self, points: Floats, parameters: Parameters) -> bytes:
        from puckbench.codecs.primitives.mode_decision import encode

        return encode(points, settings_of(parameters))

    def decode_mesh(self, stream: bytes) -> Mesh:
        """The surfaces of a stream as a light mesh, each triangle labelled with its primitive."""
        from puckbench.codecs.primitives.facets import decode_mesh

        try:
            header, bits = unpack(stream)
            if not isinstance(header, Header):
                raise InputError("the stream holds voxels, not planes: take a lower rate")
            return decode_mesh(header, bits)
        except InputError as error:
            raise InputError(f"codec {self.name}: {error}") from error

    def _decode(self, stream: bytes) -> Floats:
        from puckbench.codecs.primitives.decoder import decode_stream

        try:
            return decode_stream(stream)
        except InputError as error:
            raise InputError(f"codec {self.name}: {error}") from error
