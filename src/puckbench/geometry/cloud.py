"""Point clouds: coordinates with optional attributes, and what is known about them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, NonNegativeFloat, NonNegativeInt, PositiveFloat

from puckbench.core.errors import InputError
from puckbench.core.models import Model, parsed

if TYPE_CHECKING:
    from puckbench.lidar.returns import Returns

Floats = NDArray[np.float64]
Frame = Literal["scaled", "metric"]
"""Of a cloud's coordinates: scaled to a cube of whole-numbered grid positions, or metres."""
_MOST_SIZE = 2**53
"""Whole numbers below it are exact as floating-point numbers."""


class _Grid(Model, extra="ignore"):
    """The grid of voxels that a cloud came on."""

    metres: PositiveFloat
    origin: tuple[float, float, float]
    size: Annotated[int, Field(ge=2, lt=_MOST_SIZE)]


class _Described(Model, extra="ignore"):
    """What some entries of a cloud's description must be, where it has them."""

    name: str = ""
    group: str = ""
    size: Annotated[int, Field(ge=0, lt=_MOST_SIZE)] | None = None
    scale: PositiveFloat = 1.0
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    peak: PositiveFloat | None = None
    diameter: NonNegativeFloat = 0.0
    turns: NonNegativeInt = 0
    seconds: NonNegativeFloat | None = None
    grid: _Grid | None = None


@dataclass(frozen=True)
class PointCloud:
    """Points with optional attributes and a description.

    Parameters
    ----------
    xyz
        Coordinates, (n, 3) float64.
    normals
        Unit vectors, (n, 3) float64, or None.
    colours
        RGB, (n, 3) uint8, or None.
    labels
        (n,) int32, or None.
    about
        The JSON beside the file: source, seed, ``scale`` and ``offset`` to metres, ``size`` of the
        cube that it is scaled to (0: metres), and more.
    returns
        The returns of a spinning sensor whose points these are, row by row, or None.
    fields
        Further values of every point by name, (n,) each: intensity, time, classification.

    Raises
    ------
    InputError
        An entry of the description that puckbench reads, such as ``scale``, is not what it must be.
    """

    xyz: Floats
    normals: Floats | None = None
    colours: NDArray[np.uint8] | None = None
    labels: NDArray[np.int32] | None = None
    about: dict[str, Any] = field(default_factory=dict)
    returns: Returns | None = None
    fields: Mapping[str, NDArray[Any]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        read = _Described.model_fields.keys() & self.about.keys()
        if read:
            parsed(_Described, {name: self.about[name] for name in read}, "the cloud's description")

    def __len__(self) -> int:
        return len(self.xyz)

    @property
    def frame(self) -> Frame | None:
        """What the coordinates are, by the cloud's description; None where that does not say."""
        size = self.about.get("size")
        if size is None:
            return None
        return "scaled" if size else "metric"

    @property
    def peak(self) -> float | None:
        """Peak of MPEG's PSNRs, in the cloud's units; None where it is not known.

        Of a scaled cloud it is the largest coordinate that it can have; one in metres names it.
        """
        if self.frame == "scaled":
            return float(self.about["size"]) - 1
        peak = self.about.get("peak")
        return None if peak is None else float(peak)

    def finite(self) -> PointCloud:
        """The cloud without points that are not finite."""
        return self.select(np.flatnonzero(np.isfinite(self.xyz).all(axis=1)))

    def select(self, rows: NDArray[Any]) -> PointCloud:
        """The cloud of some rows (a mask or indices), with their attributes, without returns."""
        return replace(
            self,
            xyz=self.xyz[rows],
            normals=None if self.normals is None else self.normals[rows],
            colours=None if self.colours is None else self.colours[rows],
            labels=None if self.labels is None else self.labels[rows],
            returns=None,
            fields={name: values[rows] for name, values in self.fields.items()},
        )

    def to_metres(self, points: Floats) -> Floats:
        """Transform points (m, 3) of this cloud to metres: ``points / scale + offset``."""
        scale, offset = self.about.get("scale", 1.0), self.about.get("offset", (0.0, 0.0, 0.0))
        return np.asarray(points / scale + np.asarray(offset))


def bounds(points: Floats) -> Floats:
    """Least and greatest coordinates (2, 3); ten times faster than NumPy's along an axis."""
    columns = [points[:, axis] for axis in range(3)]
    return np.array([[column.min() for column in columns], [column.max() for column in columns]])


_LEAST_EXTENT, _FARTHEST = 1e-30, 1e30
"""Bounds within which squares of lengths, and squares of these, are numbers."""


def check_extent(points: Floats, what: str) -> None:
    """Refuse points (n, 3) that are all the same, or lie where numbers no longer tell them apart.

    Raises
    ------
    InputError
        Begins with `what`, the name of their source.
    """
    low, high = bounds(points)
    extent = float((high / 2 - low / 2).max()) * 2
    if extent == 0:
        raise InputError(f"{what}: the cloud has no extent: all its points are the same")
    farthest = float(max(np.abs(low).max(), np.abs(high).max()))
    if extent < _LEAST_EXTENT or farthest > _FARTHEST:
        raise InputError(
            f"{what}: coordinates up to {farthest:.3g} and an extent of {extent:.3g} are no "
            "lengths; name the unit (--metres-per-unit)"
        )


def check_points(points: Floats, what: str) -> None:
    """Refuse points that are not a non-empty, finite (n, 3) array.

    Raises
    ------
    InputError
        Begins with `what`, the name of their source.
    """
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"{what}: expected points of shape (n, 3), got {points.shape}")
    if len(points) == 0:
        raise InputError(f"{what}: the cloud is empty")
    if not np.isfinite(points).all():
        bad = int(np.count_nonzero(~np.isfinite(points).all(axis=1)))
        raise InputError(f"{what}: {bad} of {len(points)} points are not finite")
