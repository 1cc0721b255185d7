"""The codec PCGCv2: points on the integer grid, coded with trained weights.

Points are rounded to voxels of size one and equal voxels merged, as the thesis ran it on clouds
scaled to [0, 1023]. The network is made for dense surfaces.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from puckbench.cloud import Floats
from puckbench.codecs.learned.codec import LearnedByAlpha
from puckbench.codecs.pcgcv2.catalogue import NETWORK
from puckbench.codecs.pcgcv2.stream import Coded, read_stream, write_coded, write_few
from puckbench.errors import InputError

if TYPE_CHECKING:
    from puckbench.codecs.pcgcv2.coder import Coder
    from puckbench.codecs.pcgcv2.weights import WeightSet

_FEW = 64
"""Up to so many points are kept as they are: a network can say nothing about them."""


class Pcgcv2(LearnedByAlpha["WeightSet"]):
    """PCGCv2 (Wang et al. 2021); a rate may have a `rho`, the share of voxels that are kept."""

    version = "PCGCv2, stream version 1"
    network = NETWORK
    grid = 1.0

    def _stream(self, points: Floats, parameters: Mapping[str, Any]) -> bytes:
        if len(points) <= _FEW:
            return write_few(np.unique(points, axis=0))
        if np.abs(points).max() >= 2**31 - 2**20:
            raise InputError("coordinates exceed 32-bit integers")
        return write_coded(self._coder(parameters).encode(np.rint(points).astype(np.int64)))

    def _coder(self, parameters: Mapping[str, Any]) -> Coder:
        from puckbench.codecs.pcgcv2.coder import Coder

        weights, rate = self._numbered(parameters)
        rho = float(parameters.get("rho", 1))
        return Coder(weights, rate, rho=rho, threads=self.threads)

    def _points(self, stream: bytes) -> Floats:
        from puckbench.codecs.pcgcv2.coder import Coder

        coded = read_stream(stream)
        if not isinstance(coded, Coded):
            return coded
        weights = self._of_rate(coded.digest, coded.rate)
        return Coder(weights, coded.rate, threads=self.threads).decode(coded).astype(np.float64)

    def _read(self, path: Path) -> WeightSet:
        from puckbench.codecs.pcgcv2.weights import load_weights

        return load_weights(path)
