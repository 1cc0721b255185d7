"""The codec contract: one class, one self-contained byte string, an ordered table of rates."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats, check_points
from puckbench.geometry.mesh import Mesh


class Availability(NamedTuple):
    """Whether a codec can run here and, if not, why (one line)."""

    ok: bool
    why: str = ""


class Cost(NamedTuple):
    """What a call cost: seconds, and peak memory in MiB."""

    seconds: float
    peak_mib: float


class Codec(ABC):
    """A point-cloud geometry codec.

    A subclass implements `_encode` and `_decode`; the checks common to all codecs are here.
    Options from the codec's entry (a weights folder, say) are keyword arguments of the subclass.

    name: the entry's name. rates: parameters per rate name, the smallest bitrate (r1) first.
    """

    grid: float = 0.0
    """Spacing of the grid that coordinates are rounded to at the finest rate, in units of the
    input; 0 for a codec that adapts to the extent of the cloud."""

    rates: Mapping[str, Mapping[str, Any]] = MappingProxyType({})
    """A class of one's own may name its rates here, for where its entry names none."""

    def __init__(self, name: str, rates: Mapping[str, Mapping[str, Any]] | None = None) -> None:
        self.name = name
        self.rates = dict(self.rates if rates is None else rates)

    @property
    def version(self) -> str:
        """Version of the implementation, for the results table; a class may just assign it."""
        return ""

    def weights_of(self, rate: str) -> str:
        """Which trained weights code at a rate, for the results table; most codecs have none."""
        return ""

    def available(self) -> Availability:
        """Whether the codec can run on this machine."""
        return Availability(True)

    def load(self) -> None:  # noqa: B027 (most codecs have nothing to load)
        """Do once, outside the timed calls, what a first call would pay for (weights, JIT)."""

    def cost(self) -> Cost | None:
        """What the last call cost, for a codec that runs outside this process; else None."""
        return None

    def encode(self, points: Floats, rate: str) -> bytes:
        """Code points (n, 3) at a named rate; the bytes are all that the decoder needs.

        InputError for an unknown rate, an empty cloud or coordinates that are not finite.
        """
        if rate not in self.rates:
            known = ", ".join(self.rates)
            raise InputError(f"codec {self.name}: unknown rate '{rate}' (known: {known})")
        check_points(points, f"codec {self.name}")
        return self._encode(np.ascontiguousarray(points, dtype=np.float64), self.rates[rate])

    def decode(self, stream: bytes) -> Floats:
        """Points (m, 3) in the coordinates of the input cloud, in any order.

        InputError for a stream that is not this codec's, or damaged.
        """
        return self._decode(stream)

    def decode_mesh(self, stream: bytes) -> Mesh:
        """Triangles in the coordinates of the input cloud, where a codec codes surfaces.

        The labels say which geometric primitive each triangle lies on (kind and parameters as in
        `puckbench.geometry.mesh`, in those coordinates too) and, as object, which piece of surface
        it belongs to: a wall is one object however many primitives it was coded in.

        InputError as for `decode`, for a codec that has no surfaces, and for a stream without one.
        """
        raise InputError(f"codec {self.name}: codes points, not surfaces")

    @abstractmethod
    def _encode(self, points: Floats, parameters: Mapping[str, Any]) -> bytes: ...

    @abstractmethod
    def _decode(self, stream: bytes) -> Floats: ...
