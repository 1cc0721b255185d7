"""The codec PCGCv2: points on the integer grid, coded with trained weights.

Points are rounded to voxels and equal voxels merged. The network is made for dense surfaces: a rate
may say the `mean_occupied_children` of a voxel, and the grid of a sparse cloud is coarsened until
voxels have as many; without it voxels have size one, as the thesis ran the codec on clouds scaled
to [0, 1023].
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from puckbench.codecs.learned.codec import LearnedByAlpha, dense_quarters
from puckbench.codecs.learned.pcgcv2.catalogue import NETWORK
from puckbench.codecs.learned.pcgcv2.stream import Coded, Rules, read_stream, write_coded, write_few
from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats

if TYPE_CHECKING:
    from puckbench.codecs.learned.pcgcv2.coder import Coder
    from puckbench.codecs.learned.pcgcv2.weights import WeightSet

_FEW = 64
"""Up to so many points are kept as they are: a network can say nothing about them."""


class Pcgcv2(LearnedByAlpha["WeightSet"]):
    """PCGCv2 (Wang et al. 2021); a rate may have a `rho`, the share of voxels that are kept.

    As published the likeliest voxels are kept wherever they are: those of thin parts then vanish.
    """

    version = "PCGCv2, stream version 6"
    network = NETWORK
    grid = 1.0

    def __init__(self, **entry: Any) -> None:
        super().__init__(**entry)
        families = Rules(0) if self.as_published else Rules.FAMILIES
        self.rules = families | (Rules.CONTEXTS if self.contexts else Rules(0))

    def _stream(self, points: Floats, parameters: Mapping[str, Any]) -> bytes:
        from puckbench.codecs.learned.grid_level import on_grid

        if len(points) <= _FEW:
            return write_few(np.unique(points, axis=0))
        if np.abs(points).max() >= 2**31 - 2**20:
            raise InputError("coordinates exceed 32-bit integers")
        quarters = 0 if self.as_published else dense_quarters(points, parameters)
        voxels = on_grid(points, quarters)
        return write_coded(self._coder(parameters).encode(voxels, quarters))

    def _coder(self, parameters: Mapping[str, Any]) -> Coder:
        from puckbench.codecs.learned.pcgcv2.coder import Coder

        weights, rate = self._numbered(parameters)
        rho = float(parameters.get("rho", 1))
        return Coder(weights, rate, rho, threads=self.threads, rules=self.rules, fill=self.fill)

    def _points(self, stream: bytes) -> Floats:
        from puckbench.codecs.learned.pcgcv2.coder import Coder

        coded = read_stream(stream)
        if not isinstance(coded, Coded):
            return coded
        weights = self._of_rate(coded.digest, coded.rate)
        return Coder(weights, coded.rate, threads=self.threads).decode(coded)

    def _read(self, path: Path) -> WeightSet:
        from puckbench.codecs.learned.pcgcv2.weights import load_weights

        return load_weights(path)
