from __future__ import annotations

from collections.abc import Mapping

from pydantic import Field

from pointkit.models import Model

UNITS = 1023.0
"""Number of units along the longest side of a cloud."""

_REFERENCE_NOISE = 1.3
"""Noise, in units, for which the rates are tuned: a VLP-16 in a six-metre room."""


class PrimitiveSettings(Model):
    """The rate at which a cloud is encoded; `RATES` holds eight proven sets of values.

    Lengths are in units of 1/1023 of the cloud's longest side. With `min_leaf_size` 0 only voxels
    are coded. With `refinement` above 0 voxels are coded in addition to the surface.
    """

    max_bpp: float = Field(
        default=1.0, ge=0, description="largest number of bits per point of a surface or of voxels"
    )
    max_voxel_size: float = Field(
        default=UNITS / 4, ge=0, description="largest side of a voxel, even if it needs more bits"
    )
    refinement: float = Field(
        default=0.0,
        ge=0,
        le=1,
        description="budget of the hybrid mode on a logarithmic scale, from 0 (the surface alone) "
        "to 1 (refined_bpp, or the bits of voxels of max_voxel_size if these are more)",
    )
    refined_bpp: float = Field(
        default=3.5, gt=0, description="bits per point of the hybrid mode at refinement 1"
    )
    min_leaf_size: float = Field(
        default=16.0,
        ge=0,
        description="side of the smallest leaves; 0 codes voxels only",
    )
    column_size: float = Field(
        default=4.0,
        ge=0,
        description="side of a column of an occupancy map: min_leaf_size / 2^k",
    )
    max_leaf_size: float = Field(default=128.0, ge=0, description="side of the largest leaves")
    lmbda: float = Field(
        default=10.0,
        ge=0,
        description="Lagrangian weight of rate against distortion: squared error per bit per point",
    )
    plane_step: float = Field(
        default=3.0, ge=0, description="quantisation step of planes in the smallest leaves"
    )
    smoothing_radius: float = Field(
        default=19.0,
        ge=0,
        description="radius of the smoothing neighbourhood, in standard deviations of the noise",
    )

    def adapted_to(self, noise: float) -> PrimitiveSettings:
        """Return a copy of the settings that suits the noise of a cloud.

        Noise above 1.3 units enlarges leaves, columns and the quantisation step of planes in
        proportion, because finer ones would reproduce the noise.

        Parameters
        ----------
        noise
            Standard deviation of the noise, in units of 1/1023 of the cloud's longest side.
        """
        factor = max(noise / _REFERENCE_NOISE, 1.0)
        length_names = ("min_leaf_size", "column_size", "plane_step")
        scaled = {name: factor * getattr(self, name) for name in length_names}
        return self.model_copy(update={**scaled, "lmbda": factor**2 * self.lmbda})


_SURFACE_PARAMETERS = (
    *("min_leaf_size", "column_size", "max_leaf_size"),
    *("lmbda", "plane_step", "max_bpp"),
)
_SURFACES: dict[str, dict[str, float]] = {
    name: dict(zip(_SURFACE_PARAMETERS, row, strict=True))
    for name, row in {
        "r1": (64, 32, 256, 3000, 12, 0.1),
        "r2": (32, 16, 256, 600, 8, 0.2),
        "r3": (16, 8, 256, 70, 4.5, 0.4),
        "r4": (8, 4, 128, 8, 3, 0.7),
        "r5": (4, 2, 64, 0.7, 1, 1.2),
    }.items()
}
RATES: Mapping[str, Mapping[str, float]] = {
    **_SURFACES,
    **{
        f"r{5 + k}": {**_SURFACES["r5"], "refinement": k / 3, "max_voxel_size": 4}
        for k in (1, 2, 3)
    },
}
"""Arguments of `PrimitiveSettings` for eight rates, from `r1` (fewest bits) to `r8`.

Rates `r1` to `r5` code a surface alone, with finer and finer leaves. Rates `r6` to `r8` add voxels
to the surface of `r5`, so that the decoded points also follow points that lie on no surface.
"""
