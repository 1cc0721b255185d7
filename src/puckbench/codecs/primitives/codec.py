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
from puckbench.mesh import Mesh

_LARGEST_VOXEL = 4.0


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

    def decode_mesh(self, stream: bytes) -> Mesh:
        """The planes of a stream as a light mesh, each triangle labelled with its plane."""
        from puckbench.codecs.primitives.facets import decode_mesh

        try:
            header, bits = unpack(stream)
            if not isinstance(header, Header):
                raise InputError("the stream holds voxels, not planes: take a lower rate")
            return decode_mesh(header, bits)
        except InputError as error:
            raise InputError(f"codec {self.name}: {error}") from error

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
    from puckbench.codecs.primitives.encoder import encode_surface, noise_of

    unit = float(np.ptp(points, axis=0).max()) / SIZE
    if unit == 0:
        return _voxels(points, 1.0)
    if settings.voxel == 0:
        stream = encode_surface(points, settings)
        return _voxels(points, settings.leaf * unit) if stream is None else stream
    least = min(settings.voxel_noise * noise_of(points, unit), _LARGEST_VOXEL)
    return _voxels(points, max(settings.voxel, least) * unit)


def _voxels(points: Floats, side: float) -> bytes:
    from puckbench.codecs.gpcc.lossless import encode_voxels

    low = points.min(axis=0)
    return pack_voxels(low, side, encode_voxels(np.rint((points - low) / side).astype(np.int64)))
