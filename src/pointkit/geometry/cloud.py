"""Point clouds: coordinates, optional attributes and a description."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, NonNegativeFloat, NonNegativeInt, PositiveFloat

from pointkit.errors import InputError, naming
from pointkit.models import Model, parsed

if TYPE_CHECKING:
    from pointkit.lidar.returns import Returns

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
CoordinateFrame = Literal["scaled", "metric"]
"""Frame of coordinates: scaled to a cube of integer grid positions, or metric (metres)."""
INTEGER_LIMIT = 2**53
"""Integers below this are exact in double precision."""


class _VoxelGrid(Model, extra="ignore"):
    metres: PositiveFloat
    origin: tuple[float, float, float]
    size: Annotated[int, Field(ge=2, lt=INTEGER_LIMIT)]


class _Description(Model, extra="ignore"):
    name: str = ""
    group: str = ""
    size: Annotated[int, Field(ge=0, lt=INTEGER_LIMIT)] | None = None
    scale: PositiveFloat = 1.0
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    peak: PositiveFloat | None = None
    diameter: NonNegativeFloat = 0.0
    turns: NonNegativeInt = 0
    seconds: NonNegativeFloat | None = None
    metres_per_unit: PositiveFloat = 1.0
    grid: _VoxelGrid | None = None


@dataclass(frozen=True)
class PointCloud:
    """Points with optional attributes, which are checked when the cloud is created.

    Lists and arrays of whole numbers are converted to the types below. ``len(cloud)`` is the number
    of points.

    Parameters
    ----------
    xyz
        Coordinates, (n, 3) float64, finite.
    normals
        Unit vectors, (n, 3) float64.
    colours
        Red, green and blue, (n, 3) uint8; a cloud that is only written may have uint16.
    labels
        Class or object of each point, (n,) int32.
    about
        Description of the cloud, such as its source, seed and parameters. ``size`` is the side of
        the cube to which the coordinates are scaled (0: they are in metres). ``scale`` and
        ``offset`` convert to metres (see `to_metres`).
    returns
        Returns of a spinning sensor from which the points were computed, one return for each point.
    fields
        Further attributes by name, (n,) numbers each.

    Raises
    ------
    InputError
        An array has another shape, is not of numbers, or does not fit its type; a point is not
        finite; or the description is not valid.
    """

    xyz: Floats
    normals: Floats | None = None
    colours: NDArray[np.uint8] | None = None
    labels: NDArray[np.int32] | None = None
    about: dict[str, Any] = field(default_factory=dict)
    returns: Returns | None = None
    fields: Mapping[str, NDArray[Any]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        xyz = _numbers(self.xyz, "points", (None, 3))
        count = len(xyz)
        arrays = {"xyz": xyz.astype(np.float64) if xyz.dtype.kind in "iu" else xyz}
        if self.normals is not None:
            arrays["normals"] = _numbers(self.normals, "normals", (count, 3))
        if self.colours is not None:
            arrays["colours"] = _integers(self.colours, "colours", (count, 3), self._colour_type())
        if self.labels is not None:
            arrays["labels"] = _integers(self.labels, "labels", (count,), np.int32)
        for name, array in arrays.items():
            object.__setattr__(self, name, array)
        object.__setattr__(self, "fields", _fields(self.fields, count))
        if self.returns is not None and len(self.returns) != count:
            raise InputError(f"{len(self.returns)} returns for {count} points")
        self._check_finite()
        if not isinstance(self.about, Mapping):
            raise InputError(f"the cloud's description: not a dict, but {_kind(self.about)}")
        names = _Description.model_fields.keys() & self.about.keys()
        if names:
            entries = {name: self.about[name] for name in names}
            parsed(_Description, entries, "the cloud's description")

    def _colour_type(self) -> type[np.uint8 | np.uint16]:
        colours: Any = self.colours
        is_wide = isinstance(colours, np.ndarray) and colours.dtype == np.uint16
        return np.uint16 if is_wide and colours.max(initial=0) > 0xFF else np.uint8

    def _check_finite(self) -> None:
        check_finite(self.xyz)

    def __len__(self) -> int:
        return len(self.xyz)

    @property
    def frame(self) -> CoordinateFrame | None:
        """Frame of the coordinates; None if the description has no ``size``."""
        size = self.about.get("size")
        if size is None:
            return None
        return "scaled" if size else "metric"

    @property
    def peak(self) -> float | None:
        """Peak value for MPEG's PSNR metrics, in the cloud's unit; None if unknown."""
        if self.frame == "scaled":
            return float(self.about["size"]) - 1
        peak = self.about.get("peak")
        return None if peak is None else float(peak)

    @property
    def metres_per_unit(self) -> float:
        """Factor by which the coordinates of the source file were multiplied, by default 1."""
        return float(self.about.get("metres_per_unit", 1.0))

    def select(self, rows: NDArray[Any]) -> Self:
        """Return a cloud of the points that a mask (n,) or indices select, without `returns`."""
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
        """Transform points (m, 3) from the cloud's unit to metres: ``points / scale + offset``."""
        scale, offset = self.about.get("scale", 1.0), self.about.get("offset", (0.0, 0.0, 0.0))
        return np.asarray(points / scale + np.asarray(offset))


@dataclass(frozen=True)
class UncheckedCloud(PointCloud):
    """A cloud as a file contains it, in which coordinates may be infinite or not a number."""

    def _check_finite(self) -> None:
        pass

    def checked(self) -> PointCloud:
        """Return the cloud as a `PointCloud`; raise InputError if a point is not finite."""
        return PointCloud(**vars(self))


def _numbers(values: Any, what: str, shape: tuple[int | None, ...]) -> NDArray[Any]:
    try:
        array = np.asarray(values)
    except ValueError as error:  # lists of different lengths
        raise InputError(f"{what}: not an array ({error})") from error
    if array.dtype.kind not in "fiu":
        raise InputError(f"{what}: not numbers, but {_kind(values)}")
    if len(shape) != array.ndim or any(
        size not in (None, actual) for size, actual in zip(shape, array.shape, strict=True)
    ):
        expected = str(shape).replace("None", "n")
        raise InputError(f"expected {what} of shape {expected}, got {array.shape}")
    return array


def _integers(
    values: Any, what: str, shape: tuple[int, ...], kind: type[np.integer[Any]]
) -> NDArray[Any]:
    array = _numbers(values, what, shape)
    with np.errstate(invalid="ignore"):
        converted = array.astype(kind, copy=False)
    if array.dtype != kind and not np.array_equal(converted, array):
        limits = np.iinfo(kind)
        raise InputError(f"{what}: not whole numbers from {limits.min} to {limits.max}")
    return converted


def _fields(fields: Any, count: int) -> dict[str, NDArray[Any]]:
    if not isinstance(fields, Mapping):
        raise InputError(f"fields: not arrays by name, but {_kind(fields)}")
    arrays = {name: np.asarray(values) for name, values in fields.items()}
    for name, array in arrays.items():
        if array.dtype.kind not in "fiub" or array.shape != (count,):
            what = f"{_kind(array)} of shape {array.shape}"
            raise InputError(
                f"field {name}: expected a number for each of {count} points, got {what}"
            )
    return arrays


def _kind(values: Any) -> str:
    return (
        f"an array of {values.dtype}" if isinstance(values, np.ndarray) else type(values).__name__
    )


def bounds(points: Floats) -> Floats:
    """Return the bounding box (2, 3) of points (n, 3), lowest corner first."""
    columns = [points[:, axis] for axis in range(3)]  # ten times faster than points.min(axis=0)
    return np.array([[column.min() for column in columns], [column.max() for column in columns]])


_SMALLEST_EXTENT, _LARGEST_COORDINATE = 1e-30, 1e30
"""Fourth powers of lengths between these limits neither underflow nor overflow."""


def check_extent(points: Floats, source: str) -> None:
    """Raise InputError if all points (n, 3) are equal, or their extent is too small or large."""
    low, high = bounds(points)
    extent = float((high / 2 - low / 2).max()) * 2
    if extent == 0:
        raise InputError(f"{source}: the cloud has no extent: all its points are the same")
    largest = float(max(np.abs(low).max(), np.abs(high).max()))
    if extent < _SMALLEST_EXTENT or largest > _LARGEST_COORDINATE:
        raise InputError(
            f"{source}: coordinates up to {largest:.3g} and an extent of {extent:.3g} cannot be "
            "metres; name the unit (--metres-per-unit)"
        )


def check_points(points: Floats, source: str) -> None:
    """Raise InputError unless `points` is a non-empty, finite array (n, 3).

    The message begins with `source`.
    """
    with naming(source):
        _numbers(points, "points", (None, 3))
        if len(points) == 0:
            raise InputError("the cloud is empty")
        check_finite(points)


def check_finite(points: Floats) -> None:
    """Raise InputError if a coordinate of points (n, 3) is NaN or infinite."""
    if not np.isfinite(points).all():
        invalid = int(np.count_nonzero(~np.isfinite(points).all(axis=1)))
        raise InputError(f"{invalid} of {len(points)} points are not finite")
