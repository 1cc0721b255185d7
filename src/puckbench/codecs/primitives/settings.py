"""What a rate stands for, in thousandths (1/1023) of the cloud's longest side."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

from puckbench.core.errors import InputError

SIZE = 1023.0
"""Units across the longest side of a cloud."""

_USUAL_NOISE = 1.3
"""Noise that the rates are made for: a VLP-16 in a room of six metres, by `noise.spread`."""


@dataclass(frozen=True)
class Settings:
    """Parameters of a rate, lengths in units.

    bpp: bits per point that voxels may take, and surfaces before voxels are taken instead. leaf,
    cell: sides of the least leaf (0: voxels alone) and of a bitmap's column, powers of two apart;
    largest: side of the largest leaf. voxel: side that no voxel exceeds, whatever it costs.
    price: squared error that a bit per point may save. step: precision of planes at the least
    leaves. reach: radius of smoothing in standard deviations of the noise.
    """

    bpp: float = 1.0
    voxel: float = SIZE / 4
    leaf: float = 16.0
    cell: float = 4.0
    largest: float = 128.0
    price: float = 10.0
    step: float = 3.0
    reach: float = 19.0

    def coarsened(self, noise: float) -> Settings:
        """For a noise (units) above the usual: finer planes than these would follow it."""
        factor = max(noise / _USUAL_NOISE, 1.0)
        lengths = {name: factor * getattr(self, name) for name in ("leaf", "cell", "step")}
        return replace(self, **lengths, price=factor**2 * self.price)


def settings_of(parameters: Mapping[str, Any]) -> Settings:
    """Settings from a rate's entry; InputError for a name that is none or a value not above 0."""
    known = {field.name for field in fields(Settings)}
    for name, value in parameters.items():
        if name not in known or not isinstance(value, int | float) or value < 0:
            raise InputError(f"codec primitives: bad parameter {name}: {value!r}")
    return Settings(**parameters)
