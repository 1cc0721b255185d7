"""The codec: points on gpcc's grids, coded without loss there by a small learned octree coder.

A rate is the grid's scale, so that decoded points are those of `gpcc` with merged duplicates, and
only the bytes differ.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from puckbench.codecs.gpcc.grid import frame_of, in_frame, quantised
from puckbench.codecs.learned.codec import Learned
from puckbench.codecs.learned.octree_net.catalogue import NETWORK
from puckbench.codecs.learned.octree_net.stream import Coded, read_stream, write_stream
from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats

if TYPE_CHECKING:
    from puckbench.codecs.learned.octree_net.weights import Weights


class SparseOctreeNet(Learned["Weights"]):
    """A learned octree coder, lossless on its grid.

    unit: step of the input's grid, on which ``scale`` 1 works.
    """

    version = "sparse_octree_net, stream version 3"
    network = NETWORK

    def __init__(self, *, unit: float = 1.0, **entry: Any) -> None:
        super().__init__(**entry)
        if not 0 < unit < float("inf"):
            raise InputError(f"codec {self.name}: unit must be a positive number, not {unit}")
        self.unit = unit
        self.grid = unit / max((rate["scale"] for rate in self.rates.values()), default=1.0)

    def load(self) -> None:
        """Load the weights, and compile what is compiled on first use, at a scale that uses it."""
        self._try([{"scale": 1}])

    def _stream(self, points: Floats, parameters: Mapping[str, Any]) -> bytes:
        return write_stream(self._coded(points, float(parameters["scale"])))

    def _coded(self, points: Floats, scale: float) -> Coded:
        from puckbench.codecs.learned.octree_net.coder import Coder, split
        from puckbench.codecs.learned.sparse.voxels import AXIS_BITS, distinct, morton_keys

        frame = frame_of(points, self.unit, scale)
        positions, origin = quantised(points, frame, scale, "nearest")
        if positions.max() >= 2**AXIS_BITS:
            raise InputError(f"the cloud spans more than {AXIS_BITS} bits at scale {scale:g}")
        weights = self._weights({"scale": scale})
        coder = Coder(weights.model, self.threads)
        parts = tuple(coder.encode(keys) for keys in split(distinct(morton_keys(positions))))
        x, y, z = origin.tolist()
        return Coded(weights.digest, scale, (x, y, z), frame, parts)

    def _points(self, stream: bytes) -> Floats:
        from puckbench.codecs.learned.octree_net.coder import Coder
        from puckbench.codecs.learned.sparse.voxels import morton_voxels

        coded = read_stream(stream)
        coder = Coder(self._made_with(coded.digest).model, self.threads)
        keys = np.concatenate([coder.decode(part) for part in coded.parts])
        units = (morton_voxels(keys) + np.array(coded.origin)) / coded.scale
        return in_frame(units, coded.frame)

    def _read(self, path: Path) -> Weights:
        from puckbench.codecs.learned.octree_net.weights import load_weights

        return load_weights(path)
