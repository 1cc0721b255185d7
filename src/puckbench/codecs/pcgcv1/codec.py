"""The codec PCGCv1: points on the integer grid, coded cube by cube with a folder of weights.

A rate is the alpha of its weights, the number of voxels per unit (`scale`) and of voxels kept for
each one that was occupied (`rho`): PCC Arena's table, as the thesis ran it. Cubes with fewer than
`min_points` points are no food for the network: their voxels are coded without loss, by the octree
coder of `gpcc` (`sparse_cubes`); the original drops them. PyTorch is loaded only when something is
coded.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from puckbench.cloud import Floats
from puckbench.codecs.codec import Availability, Codec
from puckbench.codecs.pcgcv1.catalogue import files_by_alpha
from puckbench.codecs.pcgcv1.stream import Coded, read_stream, write_stream
from puckbench.errors import InputError

if TYPE_CHECKING:
    from puckbench.codecs.pcgcv1.coder import Coder
    from puckbench.codecs.pcgcv1.weights import WeightSet

_NEEDED = {"torch": "PyTorch", "constriction": "constriction"}


class Pcgcv1(Codec):
    """PCGCv1 with its hyper-prior (Wang et al. 2021).

    weights: folder of weights. min_points: of a cube for the network. sparse_cubes: code smaller
    ones too. threads: of the network; PyTorch's number by default.
    """

    version = "PCGCv1, stream version 1"

    def __init__(
        self,
        *,
        weights: str | None = None,
        min_points: int = 20,
        sparse_cubes: bool = True,
        threads: int | None = None,
        **entry: Any,
    ) -> None:
        super().__init__(**entry)
        self.folder = None if weights is None else Path(weights)
        self.min_points, self.sparse_cubes = min_points, sparse_cubes
        self.threads = threads
        self._sets: dict[Path, WeightSet] = {}

    def available(self) -> Availability:
        """Whether packages and weights for every rate are here."""
        missing = [name for module, name in _NEEDED.items() if find_spec(module) is None]
        if missing:
            return Availability(False, f"{' and '.join(missing)} not installed (make learned)")
        try:
            files = self._files()
        except InputError as error:
            return Availability(False, str(error))
        lacking = [name for name, rate in self.rates.items() if float(rate["alpha"]) not in files]
        if not lacking:
            return Availability(True)
        there = ", ".join(name for name in self.rates if name not in lacking) or "none"
        return Availability(
            False, f"{self.folder} has no weights for {', '.join(lacking)} (rates it has: {there})"
        )

    def load(self) -> None:
        """Load the weights of all rates, and compile what is compiled on first use."""
        for parameters in self.rates.values():
            self._coder(parameters)
        cube = np.stack(np.meshgrid(*[np.arange(8.0)] * 3), axis=-1).reshape(-1, 3)
        for parameters in list(self.rates.values())[:1]:
            self._decode(self._encode(cube, parameters))

    def _encode(self, points: Floats, parameters: Mapping[str, Any]) -> bytes:
        if np.abs(points).max() * float(parameters.get("scale", 1)) >= 2**30:
            raise InputError(f"codec {self.name}: coordinates exceed 30-bit integers")
        try:
            return self._written(self._coder(parameters).encode(points))
        except InputError as error:
            raise InputError(f"codec {self.name}: {error}") from error

    def _written(self, coded: Coded) -> bytes:
        if not coded.cubes and not coded.sparse:
            raise InputError(
                f"no cube has {self.min_points} points, and sparse ones are dropped (sparse_cubes)"
            )
        return write_stream(coded)

    def _decode(self, stream: bytes) -> Floats:
        from puckbench.codecs.pcgcv1.coder import Decoder

        try:
            coded = read_stream(stream)
            return Decoder(self._set_of(coded), self.threads).decode(coded)
        except InputError as error:
            raise InputError(f"codec {self.name}: {error}") from error

    def _coder(self, parameters: Mapping[str, Any]) -> Coder:
        from puckbench.codecs.pcgcv1.coder import Coder

        alpha = float(parameters["alpha"])
        path = self._files().get(alpha)
        if path is None:
            raise InputError(f"codec {self.name}: {self.folder} has no weights for alpha {alpha:g}")
        weights = self._set(path)
        return Coder(
            weights,
            weights.alphas.index(alpha),
            scale=float(parameters.get("scale", 1)),
            rho=float(parameters.get("rho", 1)),
            min_points=self.min_points,
            sparse_cubes=self.sparse_cubes,
            threads=self.threads,
        )

    def _set_of(self, coded: Coded) -> WeightSet:
        """The weights that a stream names."""
        for path in sorted(set(self._files().values())):
            weights = self._set(path)
            if weights.digest == coded.digest and coded.rate < len(weights.alphas):
                return weights
        made = coded.digest.hex()
        raise InputError(f"the stream was made with other weights ({made}) than {self.folder} has")

    def _files(self) -> dict[float, Path]:
        if self.folder is None:
            raise InputError("no weights given (option weights: a folder)")
        return files_by_alpha(self.folder)

    def _set(self, path: Path) -> WeightSet:
        from puckbench.codecs.pcgcv1.weights import load_weights

        if path not in self._sets:
            self._sets[path] = load_weights(path)
        return self._sets[path]
