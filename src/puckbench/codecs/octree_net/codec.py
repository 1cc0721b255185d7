"""The codec: points on gpcc's grids, coded without loss there by a small learned octree coder.

A rate is the grid's scale, so that decoded points are those of `gpcc` with merged duplicates, and
only the bytes differ. PyTorch is loaded only when something is coded.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from puckbench.cloud import Floats
from puckbench.codecs.codec import Availability, Codec
from puckbench.codecs.gpcc.grid import frame_of, in_frame, quantised
from puckbench.codecs.octree_net.catalogue import weights_in
from puckbench.codecs.octree_net.stream import Coded, read_stream, write_stream
from puckbench.errors import InputError

if TYPE_CHECKING:
    from puckbench.codecs.octree_net.weights import Weights

_NEEDED = {"torch": "PyTorch", "constriction": "constriction"}


class SparseOctreeNet(Codec):
    """A learned octree coder, lossless on its grid.

    weights: folder with one set or more; the first by name codes, and streams find theirs.
    unit: step of the input's grid, on which ``scale`` 1 works. threads: of the network.
    """

    version = "sparse_octree_net, stream version 1"

    def __init__(
        self,
        *,
        weights: str | None = None,
        unit: float = 1.0,
        threads: int | None = None,
        **entry: Any,
    ) -> None:
        super().__init__(**entry)
        if not 0 < unit < float("inf"):
            raise InputError(f"codec {self.name}: unit must be a positive number, not {unit}")
        self.folder = None if weights is None else Path(weights)
        self.unit, self.threads = unit, threads
        self.grid = unit / max((rate["scale"] for rate in self.rates.values()), default=1.0)
        self._sets: dict[Path, Weights] = {}

    def available(self) -> Availability:
        """Whether packages and weights are here."""
        missing = [name for module, name in _NEEDED.items() if find_spec(module) is None]
        if missing:
            return Availability(False, f"{' and '.join(missing)} not installed (make learned)")
        try:
            self._files()
        except InputError as error:
            return Availability(False, str(error))
        return Availability(True)

    def load(self) -> None:
        """Load the weights, and compile what is compiled on first use."""
        cube = np.stack(np.meshgrid(*[np.arange(8.0)] * 3), axis=-1).reshape(-1, 3)
        self._decode(self._encode(cube, {"scale": 1}))

    def _encode(self, points: Floats, parameters: Mapping[str, Any]) -> bytes:
        try:
            return write_stream(self._coded(points, float(parameters["scale"])))
        except InputError as error:
            raise InputError(f"codec {self.name}: {error}") from error

    def _coded(self, points: Floats, scale: float) -> Coded:
        from puckbench.codecs.octree_net.coder import Coder, split
        from puckbench.codecs.sparse.voxels import AXIS_BITS, distinct, morton_keys

        frame = frame_of(points, self.unit, scale)
        positions, origin = quantised(points, frame, scale, "nearest")
        if positions.max() >= 2**AXIS_BITS:
            raise InputError(f"the cloud spans more than {AXIS_BITS} bits at scale {scale:g}")
        weights = self._set(self._files()[0])
        coder = Coder(weights.model, self.threads)
        parts = tuple(coder.encode(keys) for keys in split(distinct(morton_keys(positions))))
        x, y, z = origin.tolist()
        return Coded(weights.digest, scale, (x, y, z), frame, parts)

    def _decode(self, stream: bytes) -> Floats:
        try:
            return self._points(read_stream(stream))
        except InputError as error:
            raise InputError(f"codec {self.name}: {error}") from error

    def _points(self, coded: Coded) -> Floats:
        from puckbench.codecs.octree_net.coder import Coder
        from puckbench.codecs.sparse.voxels import morton_voxels

        coder = Coder(self._weights_of(coded).model, self.threads)
        keys = np.concatenate([coder.decode(part) for part in coded.parts])
        units = (morton_voxels(keys) + np.array(coded.origin)) / coded.scale
        return in_frame(units, coded.frame)

    def _files(self) -> list[Path]:
        if self.folder is None:
            raise InputError("no weights given (option weights: a folder)")
        return weights_in(self.folder)

    def _weights_of(self, coded: Coded) -> Weights:
        """The weights that a stream names."""
        for path in self._files():
            weights = self._set(path)
            if weights.digest == coded.digest:
                return weights
        made = coded.digest.hex()
        raise InputError(f"the stream was made with other weights ({made}) than {self.folder} has")

    def _set(self, path: Path) -> Weights:
        from puckbench.codecs.octree_net.weights import load_weights

        if path not in self._sets:
            self._sets[path] = load_weights(path)
        return self._sets[path]
