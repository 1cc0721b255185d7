"""Parameters of a rate of the primitives codec, in units of 1/1023 of the cloud's longest side."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import Field

from puckbench.core.models import Model, parsed

UNITS = 1023.0
"""Units across the longest side of a cloud, as in the cube [0, 1023] of a scaled cloud."""

_REFERENCE_NOISE = 1.3
"""Noise in units that the rates are made for: a VLP-16 in a room of six metres."""


class Settings(Model):
    """Parameters of a rate.

    Two candidate modes compete for a cloud: a *surface* (an octree whose leaves have planes, and
    surfaces of revolution, each with an occupancy map) and *voxels* (G-PCC's octree, displaced).
    Rates of more bits than surfaces take code both together, the *hybrid* mode.
    """

    max_bpp: float = Field(
        default=1.0, ge=0, description="bits per point that either mode may take, at most"
    )
    max_voxel_size: float = Field(
        default=UNITS / 4, ge=0, description="side of voxels, at most, however many bits they take"
    )
    refinement: float = Field(
        default=0.0,
        ge=0,
        le=1,
        description="bits of a surface and voxels together: from the surface's own (0, no voxels) "
        "to refined_bpp, or what voxels of max_voxel_size take (1), in equal ratios",
    )
    refined_bpp: float = Field(
        default=3.5, gt=0, description="bits per point of a surface and voxels at refinement 1"
    )
    min_leaf_size: float = Field(
        default=16.0,
        ge=0,
        description="side of the smallest leaves; 0 codes voxels without trying surfaces",
    )
    column_size: float = Field(
        default=4.0,
        ge=0,
        description="side of a column of an occupancy map: min_leaf_size / a power of 2",
    )
    max_leaf_size: float = Field(default=128.0, ge=0, description="side of the largest leaves")
    lmbda: float = Field(
        default=10.0,
        ge=0,
        description="Lagrangian weight: squared error that a bit per point must save",
    )
    plane_step: float = Field(
        default=3.0, ge=0, description="quantisation step of the planes of the smallest leaves"
    )
    smoothing_radius: float = Field(
        default=19.0, ge=0, description="radius of smoothing, in standard deviations of the noise"
    )

    def adapted_to(self, noise: float) -> Settings:
        """Coarsen the settings where a cloud's noise exceeds the reference.

        Otherwise fine leaves and planes would follow the noise.

        Parameters
        ----------
        noise
            Standard deviation of the points about the surface, in units.
        """
        factor = max(noise / _REFERENCE_NOISE, 1.0)
        lengths = ("min_leaf_size", "column_size", "plane_step")
        coarser = {name: factor * getattr(self, name) for name in lengths}
        return self.model_copy(update={**coarser, "lmbda": factor**2 * self.lmbda})


def rate_settings(parameters: Mapping[str, Any]) -> Settings:
    """Settings of a rate's entry; InputError for an unknown name or a value below 0."""
    return parsed(Settings, parameters, "codec primitives: rate")
