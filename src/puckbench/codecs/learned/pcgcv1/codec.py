"""The codec PCGCv1: points on the integer grid, coded cube by cube with trained weights.

A rate is the alpha of its weights, the number of voxels per unit (`scale`) and of voxels kept for
each one that was occupied (`rho`): PCC Arena's table, as the thesis ran it. It may also say how
many occupied `children` a voxel shall have in the mean: the grid of a thin cloud is halved until it
has, since the network is made for dense surfaces. Cubes with fewer than
`min_points` points are no food for the network: their voxels are coded without loss, by the octree
coder of `gpcc` (`sparse_cubes`); the original drops them.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from puckbench.codecs.learned.codec import LearnedByAlpha, dense_quarters
from puckbench.codecs.learned.pcgcv1.catalogue import NETWORK
from puckbench.codecs.learned.pcgcv1.stream import Coded, read_stream, write_stream
from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats

if TYPE_CHECKING:
    from puckbench.codecs.learned.pcgcv1.coder import Coder
    from puckbench.codecs.learned.pcgcv1.weights import WeightSet


class Pcgcv1(LearnedByAlpha["WeightSet"]):
    """PCGCv1 with its hyper-prior (Wang et al. 2021).

    min_points: of a cube for the network. sparse_cubes: code smaller ones too.
    """

    version = "PCGCv1, stream version 4"
    network = NETWORK

    def __init__(self, *, min_points: int = 20, sparse_cubes: bool = True, **entry: Any) -> None:
        super().__init__(**entry)
        self.min_points, self.sparse_cubes = min_points, sparse_cubes
        self.grid = 1 / max((rate.get("scale", 1) for rate in self.rates.values()), default=1)

    def _stream(self, points: Floats, parameters: Mapping[str, Any]) -> bytes:
        if np.abs(points).max() * float(parameters.get("scale", 1)) >= 2**30:
            raise InputError("coordinates exceed 30-bit integers")
        scaled = points * float(parameters.get("scale", 1))
        quarters = 0 if self.as_published else dense_quarters(scaled, parameters)
        return self._written(self._coder(parameters, quarters).encode(points))

    def _written(self, coded: Coded) -> bytes:
        if not coded.cubes and not coded.sparse:
            raise InputError(
                f"no cube has {self.min_points} points, and sparse ones are dropped (sparse_cubes)"
            )
        return write_stream(coded)

    def _points(self, stream: bytes) -> Floats:
        from puckbench.codecs.learned.pcgcv1.coder import Decoder

        coded = read_stream(stream)
        return Decoder(self._of_rate(coded.digest, coded.rate), self.threads).decode(coded)

    def _coder(self, parameters: Mapping[str, Any], quarters: int) -> Coder:
        from puckbench.codecs.learned.grid_level import side_of
        from puckbench.codecs.learned.pcgcv1.coder import Coder

        weights, rate = self._numbered(parameters)
        return Coder(
            weights,
            rate,
            scale=float(parameters.get("scale", 1)) / side_of(quarters),
            rho=float(parameters.get("rho", 1)),
            min_points=self.min_points,
            sparse_cubes=self.sparse_cubes,
            threads=self.threads,
            contexts=self.contexts,
            fill=self.fill,
        )

    def _read(self, path: Path) -> WeightSet:
        from puckbench.codecs.learned.pcgcv1.weights import load_weights

        return load_weights(path)
