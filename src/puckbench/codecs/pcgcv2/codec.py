"""The codec PCGCv2: points on the integer grid, coded with a folder of weights.

Points are rounded to voxels of size one and equal voxels merged, as the thesis ran it on clouds
scaled to [0, 1023]. The network is made for dense surfaces. PyTorch is loaded only when something
is coded.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from puckbench.cloud import Floats
from puckbench.codecs.codec import Availability, Codec
from puckbench.codecs.pcgcv2.catalogue import files_by_alpha
from puckbench.codecs.pcgcv2.stream import Coded, read_stream, write_coded, write_few
from puckbench.errors import InputError

if TYPE_CHECKING:
    from puckbench.codecs.pcgcv2.coder import Coder
    from puckbench.codecs.pcgcv2.weights import WeightSet

_FEW = 64
"""Up to so many points are kept as they are: a network can say nothing about them."""
_NEEDED = {"torch": "PyTorch", "constriction": "constriction"}


class Pcgcv2(Codec):
    """PCGCv2 (Wang et al. 2021); a rate is the alpha that its weights were trained with.

    weights: folder of weights. threads: of the network; PyTorch's number by default.
    """

    version = "PCGCv2, stream version 1"

    def __init__(
        self, *, weights: str | None = None, threads: int | None = None, **entry: Any
    ) -> None:
        super().__init__(**entry)
        self.folder = None if weights is None else Path(weights)
        self.threads = threads
        self._sets: dict[Path, WeightSet] = {}

    def available(self) -> Availability:
        """Whether packages and weights for every rate are here."""
        missing = [name for module, name in _NEEDED.items() if find_spec(module) is None]
        if missing:
            return Availability(False, f"{' and '.join(missing)} not installed (make learned)")
        if self.folder is None:
            return Availability(False, "no weights given (option weights: a folder)")
        try:
            files = files_by_alpha(self.folder)
        except InputError as error:
            return Availability(False, str(error))
        lacking = [name for name, rate in self.rates.items() if float(rate["alpha"]) not in files]
        if lacking:
            return Availability(False, f"{self.folder} has no weights for {', '.join(lacking)}")
        return Availability(True)

    def load(self) -> None:
        """Load the weights of all rates, and compile what is compiled on first use."""
        for parameters in self.rates.values():
            self._coder(parameters)
        cube = np.stack(np.meshgrid(*[np.arange(8.0)] * 3), axis=-1).reshape(-1, 3)
        for parameters in list(self.rates.values())[:1]:
            self._decode(self._encode(cube, parameters))

    def _encode(self, points: Floats, parameters: Mapping[str, Any]) -> bytes:
        if len(points) <= _FEW:
            return write_few(np.unique(points, axis=0))
        if np.abs(points).max() >= 2**31 - 2**20:
            raise InputError(f"codec {self.name}: coordinates exceed 32-bit integers")
        voxels = np.rint(points).astype(np.int64)
        try:
            return write_coded(self._coder(parameters).encode(voxels))
        except InputError as error:
            raise InputError(f"codec {self.name}: {error}") from error

    def _decode(self, stream: bytes) -> Floats:
        try:
            coded = read_stream(stream)
            if not isinstance(coded, Coded):
                return coded
            return self._coder_of(coded).decode(coded).astype(np.float64)
        except InputError as error:
            raise InputError(f"codec {self.name}: {error}") from error

    def _coder(self, parameters: Mapping[str, Any]) -> Coder:
        from puckbench.codecs.pcgcv2.coder import Coder

        alpha = float(parameters["alpha"])
        path = self._files().get(alpha)
        if path is None:
            raise InputError(f"codec {self.name}: no weights for alpha {alpha:g}")
        weights = self._set(path)
        rate = weights.alphas.index(alpha)
        return Coder(weights, rate, rho=float(parameters.get("rho", 1)), threads=self.threads)

    def _coder_of(self, coded: Coded) -> Coder:
        """The coder for the weights that a stream names."""
        from puckbench.codecs.pcgcv2.coder import Coder

        for path in sorted(set(self._files().values())):
            weights = self._set(path)
            if weights.digest == coded.digest and coded.rate < len(weights.alphas):
                return Coder(weights, coded.rate, threads=self.threads)
        made = coded.digest.hex()
        raise InputError(f"the stream was made with other weights ({made}) than {self.folder} has")

    def _files(self) -> dict[float, Path]:
        if self.folder is None:
            raise InputError("no weights given (option weights: a folder)")
        return files_by_alpha(self.folder)

    def _set(self, path: Path) -> WeightSet:
        from puckbench.codecs.pcgcv2.weights import load_weights

        if path not in self._sets:
            self._sets[path] = load_weights(path)
        return self._sets[path]
