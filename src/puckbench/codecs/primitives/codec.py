"""The codec `primitives`: surfaces of all sizes, or G-PCC's octree where that is nearer."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from puckbench.codecs.base import Codec
from puckbench.codecs.primitives.settings import Settings, settings_of
from puckbench.codecs.primitives.stream import Header, unpack
from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats
from puckbench.geometry.mesh import Mesh


class Primitives(Codec):
    """Geometric primitives fitted to the cloud, noise aware; see docs/primitives.md."""

    version = "3"

    def load(self) -> None:
        """Compile what encoding and decoding need."""
        from puckbench.codecs.primitives.mode_decision import encode

        rng = np.random.default_rng(0)
        plane = np.column_stack([rng.random((2000, 2)), np.zeros(2000)])
        for settings in (Settings(), Settings(leaf=0.0)):
            self._decode(encode(plane, settings))

    def _encode(self, points: Floats, parameters: Mapping[str, Any]) -> bytes:
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
