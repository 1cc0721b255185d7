"""The codec `primitives`: planes of all sizes, or G-PCC's octree where a rate asks for voxels."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from puckbench.cloud import Floats
from puckbench.codecs.codec import Codec
from puckbench.codecs.primitives.settings import SIZE, Settings, settings_of
from puckbench.codecs.primitives.stream import Header, pack_voxels, unpack
from puckbench.errors import InputError


class Primitives(Codec):
    """Geometric primitives fitted to the cloud, noise aware; see docs/primitives.md."""

    version = "1"

    def load(self) -> None:
        """Compile what encoding and decoding need."""
        rng = np.random.default_rng(0)
        plane = np.column_stack([rng.random((2000, 2)), np.zeros(2000)])
        for settings in (Settings(), Settings(voxel=8.0)):
            self._decode(_encoded(plane, settings))

    def _encode(self, points: Floats, parameters: Mapping[str, Any]) -> bytes:
        return _encoded(points, settings_of(parameters))

    def _decode(self, stream: bytes) -> Floats:
        from puckbench.codecs.gpcc.lossless import decode_voxels
        from puckbench.codecs.primitives.decoder import decode_surface

        try:
            header, bits = unpack(stream)
            if isinstance(header, Header):
                return decode_surface(header, bits).xyz
            voxels = decode_voxels(bits)
        except InputError as error:
            raise InputError(f"codec {self.name}: {error}") from error
        return np.asarray(voxels * header[1] + header[0])


def _encoded(points: Floats, settings: Settings) -> bytes:
    from puckbench.codecs.primitives.encoder import encode_surface

    extent = float(np.ptp(points, axis=0).max())
    if settings.voxel == 0 and extent > 0:
        stream = encode_surface(points, settings)
        if stream is not None:
            return stream
    return _voxels(points, extent, settings.voxel or settings.leaf)


def _voxels(points: Floats, extent: float, voxel: float) -> bytes:
    from puckbench.codecs.gpcc.lossless import encode_voxels

    low = points.min(axis=0)
    unit = voxel * extent / SIZE or 1.0
    return pack_voxels(low, unit, encode_voxels(np.rint((points - low) / unit).astype(np.int64)))
