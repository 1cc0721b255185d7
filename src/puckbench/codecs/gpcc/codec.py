"""G-PCC geometry as a codec: a grid, a bare stream of the standard, and what puckbench adds."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal

from puckbench import __version__
from puckbench.codecs.base import Codec
from puckbench.codecs.gpcc.container import packed, unpacked
from puckbench.codecs.gpcc.grid import (
    ROUNDINGS,
    Frame,
    Rounding,
    frame_of,
    in_frame,
    quantised,
)
from puckbench.codecs.gpcc.options import PROFILES, GpccOptions
from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats

Duplicates = Literal["merged", "kept"]


class GridCodec(Codec):
    """What our coder and the reference software have in common; a rate is a scale.

    profile: set of coding tools, ``minimal``, ``ctc`` or ``defaults``. rounding: see `quantised`.
    duplicates: points of one grid position are ``merged``, or ``kept`` with their number.
    unit: step of the input's grid, on which ``scale`` 1 works. raw: write bare streams.
    """

    def __init__(
        self,
        *,
        profile: str = "ctc",
        rounding: Rounding = "nearest",
        duplicates: Duplicates = "merged",
        unit: float = 1.0,
        raw: bool = False,
        **entry: Any,
    ) -> None:
        super().__init__(**entry)
        self._one_of("profile", profile, tuple(PROFILES))
        self._one_of("rounding", rounding, ROUNDINGS)
        self._one_of("duplicates", duplicates, ("merged", "kept"))
        if not 0 < unit < float("inf"):
            raise InputError(f"codec {self.name}: unit must be a positive number, not {unit}")
        self.profile, self.rounding, self.duplicates = profile, rounding, duplicates
        self.unit, self.raw = unit, raw
        self.grid = unit / max((rate["scale"] for rate in self.rates.values()), default=1.0)

    def _one_of(self, option: str, value: str, known: tuple[str, ...]) -> None:
        if value not in known:
            names = ", ".join(known)
            raise InputError(f"codec {self.name}: unknown {option} '{value}' (known: {names})")

    def _encode(self, points: Floats, parameters: Mapping[str, Any]) -> bytes:
        scale = float(parameters["scale"])
        frame = frame_of(points, self.unit, scale)
        if self.raw and frame != Frame():
            raise InputError(f"codec {self.name}: a bare stream cannot hold the unit or the offset")
        try:
            stream = self._code(points, frame, scale)
        except InputError as error:
            raise InputError(f"codec {self.name}: {error}") from error
        return stream if self.raw else packed(stream, frame)

    def _decode(self, stream: bytes) -> Floats:
        try:
            bare, frame = unpacked(stream)
            return in_frame(self._units(bare), frame)
        except InputError as error:
            raise InputError(f"codec {self.name}: {error}") from error

    @abstractmethod
    def _code(self, points: Floats, frame: Frame, scale: float) -> bytes:
        """The bare stream of points (n, 3)."""

    @abstractmethod
    def _units(self, stream: bytes) -> Floats:
        """Points (m, 3) of a bare stream, in units of the input's grid."""


class Gpcc(GridCodec):
    """Our own coder of G-PCC's octree geometry."""

    version = f"puckbench {__version__}"

    def load(self) -> None:
        """Compile the coder, or take it from the cache."""
        from puckbench.codecs.gpcc.coder import warm_up

        warm_up(self._options())

    def _options(self) -> GpccOptions:
        return replace(PROFILES[self.profile], merge_duplicates=self.duplicates == "merged")

    def _code(self, points: Floats, frame: Frame, scale: float) -> bytes:
        from puckbench.codecs.gpcc.coder import encode_geometry

        positions, origin = quantised(points, frame, scale, self.rounding)
        return encode_geometry(positions, self._options(), scale=scale, origin=origin.tolist())

    def _units(self, stream: bytes) -> Floats:
        from puckbench.codecs.gpcc.coder import decode_geometry

        return decode_geometry(stream).positions()
