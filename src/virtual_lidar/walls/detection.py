"""Detection of walls, floors and ceilings in a recording of a sensor at rest.

A plane is detected as a connected patch of pixels of the range image in which nearly all returns
lie on the plane. Returns at grazing incidence are left out; otherwise the rings that level lasers
draw on the walls would resemble a floor.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from pydantic import NonNegativeFloat, PositiveFloat, PositiveInt, model_validator

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from pointkit.geometry.ransac import Plane, robust_plane, robust_std
from pointkit.lidar.return_table import ReturnTable
from pointkit.models import Model
from virtual_lidar.residual_table import plane_coordinates

WALL, FLOOR, CEILING, OBLIQUE = "wall", "floor", "ceiling", "oblique"

Mask = NDArray[np.bool_]
"""Mask of a recording (n,), or of a range image (lasers by elevation, columns by azimuth)."""

AZIMUTH_COLUMNS = 360
"""Columns of a range image: one for each degree of azimuth."""

_FIT_ROUNDS = 10
_SAMPLES, _SAMPLE_SPAN_RAD = 384, math.radians(30)
_MOST_SCORED, _PLANES_AT_A_TIME = 4096, 32
# Returns within this number of thresholds of a patch are not used for other planes.
_TAKEN_THRESHOLDS = 3


class PlaneSearch(Model):
    """Criteria for the detection of planes in a recording.

    Parameters
    ----------
    threshold_m
        Largest distance from the plane of a return that counts as lying on the plane, after
        subtraction of the mean error (bias) of its laser.
    share_on_plane
        Least fraction of a pixel's returns that lie on the plane.
    most_planes
        Largest number of patches to examine, in order of decreasing size.
    up
        Upward direction in the sensor's coordinates, of any length.
    tilt_deg
        Largest tilt of a wall from the vertical, and of a floor or ceiling from the horizontal,
        degrees.
    most_incidence_deg
        Largest angle, in degrees, between a ray and the plane's normal; returns at larger angles
        are not used.
    inlier_sigmas
        Largest distance from the plane, in robust standard deviations, of returns that are used.
    least_laser_share
        Least number of a laser's returns on a plane, relative to the median over lasers. A laser
        with fewer returns is not used on this plane, since it follows an edge.
    least_returns, least_lasers
        Least number of returns per turn (revolution) on a plane, and least number of lasers.
    least_width_m, least_height_m
        Least width and height of the area that the returns on a plane cover.
    most_noise_m
        Largest robust standard deviation of the distances to the plane.
    """

    threshold_m: PositiveFloat = 0.03
    share_on_plane: PositiveFloat = 0.9
    most_planes: PositiveInt = 30
    up: tuple[float, ...] = (0.0, 0.0, 1.0)
    tilt_deg: PositiveFloat = 10.0
    most_incidence_deg: PositiveFloat = 75.0
    inlier_sigmas: PositiveFloat = 5.0
    least_laser_share: NonNegativeFloat = 0.25
    least_returns: PositiveInt = 100
    least_lasers: PositiveInt = 4
    least_width_m: NonNegativeFloat = 0.5
    least_height_m: NonNegativeFloat = 0.25
    most_noise_m: PositiveFloat = 0.02

    @model_validator(mode="after")
    def _of_a_direction(self) -> Self:
        if len(self.up) != 3 or not any(self.up):
            raise InputError("up must be a direction, three numbers that are not all 0")
        return self

    @property
    def least_cosine(self) -> float:
        return math.cos(math.radians(self.most_incidence_deg))


@dataclass(frozen=True)
class DetectedPlane:
    """A plane that was found in a recording, with the returns that lie on it.

    Parameters
    ----------
    kind
        `WALL`, `FLOOR`, `CEILING` or `OBLIQUE`.
    plane
        Equation of the plane; its normal points towards the sensor.
    rows
        Numbers of the recording's rows whose returns lie on the plane, (n,).
    width_m, height_m
        Extents of these returns within the plane: horizontally, and perpendicular to the
        horizontal.
    """

    kind: str
    plane: Plane
    rows: NDArray[np.intp]
    width_m: float
    height_m: float

    @property
    def distance_m(self) -> float:
        """Distance of the plane from the sensor."""
        return -self.plane.offset


@dataclass(frozen=True)
class Rejected:
    """A plane that does not meet the criteria of a `PlaneSearch`.

    Parameters
    ----------
    surface
        The plane.
    reason
        The criterion that is not met, in a few words.
    """

    surface: DetectedPlane
    reason: str


def find_surfaces(
    table: ReturnTable, search: PlaneSearch, rng: np.random.Generator
) -> tuple[list[DetectedPlane], list[Rejected]]:
    """Find walls, floors and ceilings in a recording by RANSAC, one after the other.

    Parameters
    ----------
    table
        Returns of a sensor at rest.
    search
        Criteria that a plane must meet.
    rng
        Source of the random samples.

    Returns
    -------
    taken, rejected
        Planes that meet the criteria, in decreasing number of returns; and planes that do not.
    """
    least = least_returns(table, search)
    view = _View(table.xyz, table["azimuth"], RangeImage.of(table), search, least)
    free = np.ones(len(table), dtype=bool)
    taken: list[DetectedPlane] = []
    rejected: list[Rejected] = []
    for _ in range(search.most_planes):
        plane = view.candidate(free, rng)
        if plane is None:
            break
        plane, patch = view.grown(plane, free)
        near = view.near(plane, _TAKEN_THRESHOLDS)
        rows = np.flatnonzero(near & free & view.image.rows(without_ends(patch)))
        free &= ~(near & view.image.rows(widened(patch)))
        surface = surface_of(table, rows, plane, kind_of(plane, search), search)
        reason = fault_of(table, surface, search)
        if reason is None:
            taken.append(surface)
        elif len(surface.rows):
            rejected.append(Rejected(surface, reason))
    return sorted(taken, key=lambda surface: -len(surface.rows)), rejected


def surface_of(
    table: ReturnTable, rows: NDArray[np.intp], start: Plane, kind: str, search: PlaneSearch
) -> DetectedPlane:
    """Fit a plane robustly to some returns, and select the returns that lie on the plane.

    Parameters
    ----------
    table
        The recording.
    rows
        Row numbers of the returns to fit. If they are fewer than three, the result is `start`
        without returns.
    start
        Plane with which the fit begins.
    kind
        Kind of the result, such as `WALL`.
    search
        Criteria that say which returns count as lying on the plane.

    Returns
    -------
    DetectedPlane
        The fitted plane and the selected returns.
    """
    part = table.select(rows)
    if len(rows) < 3:
        return DetectedPlane(kind, start.facing(np.zeros(3)), rows[:0], 0.0, 0.0)
    plane, near = robust_plane(part.xyz, start, sigmas=search.inlier_sigmas)
    plane = plane.facing(np.zeros(3))
    counts = near & (np.cos(incidence(part, plane)) >= search.least_cosine)
    counts &= _of_full_lasers(part["laser_id"], counts, search.least_laser_share)
    return DetectedPlane(kind, plane, rows[counts], *_extents(part.xyz[counts], plane))


def fault_of(table: ReturnTable, surface: DetectedPlane, search: PlaneSearch) -> str | None:
    """Return in a few words the first criterion that a plane fails; None if it meets all."""
    returns = len(surface.rows)
    lasers = len(np.unique(table["laser_id"][surface.rows]))
    noise = robust_std(surface.plane.distances(table.xyz[surface.rows])) if returns else 0.0
    faults = (
        (surface.kind == OBLIQUE, "neither upright nor level"),
        (returns < least_returns(table, search), f"{returns} returns"),
        (lasers < search.least_lasers, f"{lasers} lasers"),
        (surface.width_m < search.least_width_m, f"{surface.width_m:.2f} m wide"),
        (surface.height_m < search.least_height_m, f"{surface.height_m:.2f} m across"),
        (noise > search.most_noise_m, f"rough, robust standard deviation {1e3 * noise:.1f} mm"),
    )
    return next((text for is_fault, text in faults if is_fault), None)


def least_returns(table: ReturnTable, search: PlaneSearch) -> int:
    """Return the least number of returns that a plane needs in all revolutions of a recording."""
    return search.least_returns * len(np.unique(table["turn"]))


def incidence(table: ReturnTable, plane: Plane) -> Floats:
    """Return the angle between each return's nominal ray and the normal of a plane, (n,), rad."""
    azimuth, elevation = table["azimuth"], table["elevation"]
    level = np.cos(elevation)
    rays = [level * np.sin(azimuth), level * np.cos(azimuth), np.sin(elevation)]
    cosine = np.abs(np.column_stack(rays) @ plane.normal)
    return np.asarray(np.arccos(np.minimum(cosine, 1.0)))


def kind_of(plane: Plane, search: PlaneSearch) -> str:
    """Return whether a plane is a `WALL`, a `FLOOR`, a `CEILING` or `OBLIQUE`.

    The class follows from the tilt of the plane; a floor is below the sensor, and a ceiling is
    above it.
    """
    up = np.array(search.up) / np.linalg.norm(search.up)
    rise = float(plane.facing(np.zeros(3)).normal @ up)
    tilt = math.radians(search.tilt_deg)
    if abs(rise) <= math.sin(tilt):
        return WALL
    if abs(rise) < math.cos(tilt):
        return OBLIQUE
    return FLOOR if rise > 0 else CEILING


@dataclass(frozen=True)
class RangeImage:
    """Assignment of a recording's n returns to the pixels of an image.

    A row of the image belongs to a laser, in the order of elevation; a column is one degree of
    azimuth.

    Parameters
    ----------
    pixel
        Flat index of each return's pixel, (n,).
    shape
        Numbers of rows and columns of the image.
    """

    pixel: NDArray[np.intp]
    shape: tuple[int, int]

    @classmethod
    def of(cls, table: ReturnTable) -> RangeImage:
        levels, rank = np.unique(table["elevation"], return_inverse=True)
        column = (table["azimuth"] * (AZIMUTH_COLUMNS / math.tau)).astype(np.intp) % AZIMUTH_COLUMNS
        return cls(rank * AZIMUTH_COLUMNS + column, (len(levels), AZIMUTH_COLUMNS))

    @property
    def laser_rank(self) -> NDArray[np.intp]:
        return self.pixel // self.shape[1]

    def counts(self, rows: Mask) -> Floats:
        size = self.shape[0] * self.shape[1]
        counts: Floats = np.bincount(self.pixel[rows], minlength=size).astype(np.float64)
        return counts.reshape(self.shape)

    def rows(self, pixels: Mask) -> Mask:
        chosen: Mask = pixels.ravel()[self.pixel]
        return chosen


def largest_patch(pixels: Mask, returns: Floats) -> Mask:
    """Return, as a mask, the connected patch of a mask's pixels that has the most returns.

    Gaps of up to two pixels do not split a patch.

    Parameters
    ----------
    pixels
        Mask of the pixels to connect, (rows, columns).
    returns
        Number of returns in each pixel, (rows, columns).
    """
    from scipy import ndimage

    # The seam of the image is moved to the column with the fewest pixels, to not cut a patch.
    seam = int(np.argmin(pixels.sum(axis=0)))
    labels, count = ndimage.label(widened(np.roll(pixels, -seam, axis=1)))
    labels = np.roll(labels, seam, axis=1) * pixels
    sizes = np.bincount(labels.ravel(), returns.ravel(), minlength=count + 1)
    largest: Mask = pixels & (labels == 1 + int(np.argmax(sizes[1:]))) if count else pixels
    return largest


def widened(pixels: Mask) -> Mask:
    """Return a mask that also contains the eight neighbours of each pixel; azimuths are cyclic."""
    beside = pixels | np.roll(pixels, 1, axis=1) | np.roll(pixels, -1, axis=1)
    padded = np.pad(beside, ((1, 1), (0, 0)))
    wide: Mask = padded[:-2] | padded[1:-1] | padded[2:]
    return wide


def without_ends(pixels: Mask) -> Mask:
    """Return a mask without the end pixels of its rows.

    Returns in these pixels may mix two surfaces.
    """
    inner: Mask = pixels & np.roll(pixels, 1, axis=1) & np.roll(pixels, -1, axis=1)
    return inner


@dataclass(frozen=True)
class _View:
    points: Floats
    azimuth: Floats
    image: RangeImage
    search: PlaneSearch
    least: int

    def near(self, plane: Plane, thresholds: float = 1.0) -> Mask:
        close = np.abs(plane.distances(self.points)) < thresholds * self.search.threshold_m
        # The cosine of the incidence is the plane's distance over the point's.
        steep = np.linalg.norm(self.points, axis=1) * self.search.least_cosine <= abs(plane.offset)
        near: Mask = close & steep
        return near

    def candidate(self, free: Mask, rng: np.random.Generator) -> Plane | None:
        """Return the best of several random planes, or None if the best is poor.

        Each plane passes through three nearby returns; the best one has the most returns near it.

        Parameters
        ----------
        free
            Mask (n,) of the returns that may be used.
        rng
            Source of random numbers.
        """
        rows = np.flatnonzero(free)
        if len(rows) < self.least:
            return None
        scored = rows if len(rows) <= _MOST_SCORED else rng.choice(rows, _MOST_SCORED, False)
        normals, offsets = self._samples(rows, rng)
        support = self._support(self.points[scored], normals, offsets)
        best = int(np.argmax(support)) if len(support) else 0
        if not len(support) or support[best] * len(rows) < self.least * len(scored):
            return None
        return Plane(normals[best], float(offsets[best]))

    def grown(self, plane: Plane, free: Mask) -> tuple[Plane, Mask]:
        """Return a plane fitted to its largest connected patch of pixels, and this patch as a mask.

        Two steps alternate until the patch no longer changes: selection of the patch, and fitting
        of the plane. The lasers' biases are subtracted, so that no laser loses its pixels.

        Parameters
        ----------
        plane
            The plane with which to begin.
        free
            Mask (n,) of the returns that may be used.
        """
        patch = np.zeros(self.image.shape, dtype=bool)
        bias = np.zeros(len(patch))
        least_returns = self.image.counts(np.ones_like(free)) * self.search.share_on_plane
        for _ in range(_FIT_ROUNDS):
            away = np.abs(plane.distances(self.points) - bias[self.image.laser_rank])
            near = free & (away < self.search.threshold_m) & self.near(plane, 2)
            returns = self.image.counts(near)
            largest = largest_patch((returns > 0) & (returns >= least_returns), returns)
            rows = near & self.image.rows(largest)
            if np.array_equal(largest, patch) or np.count_nonzero(rows) < 3:
                break
            patch = largest
            plane, _ = robust_plane(self.points[rows], plane, sigmas=self.search.inlier_sigmas)
            bias = self._bias(plane, free & self.image.rows(widened(patch)))
        return plane, patch

    def _bias(self, plane: Plane, rows: Mask) -> Floats:
        chosen = rows & self.near(plane, 2)
        distances = plane.distances(self.points[chosen])
        lasers = self.image.laser_rank[chosen]
        parts = [distances[lasers == rank] for rank in range(self.image.shape[0])]
        medians = [float(np.median(part)) if len(part) else 0.0 for part in parts]
        return np.clip(medians, -self.search.threshold_m, self.search.threshold_m)

    def _samples(self, rows: NDArray[np.intp], rng: np.random.Generator) -> tuple[Floats, Floats]:
        """Return random planes that are not oblique, as normals (k, 3) and offsets (k,)."""
        order = rows[np.argsort(self.azimuth[rows], kind="stable")]
        span = max(3, int(len(order) * _SAMPLE_SPAN_RAD / math.tau))
        first = rng.integers(len(order), size=_SAMPLES)
        others = first + rng.integers(-span, span + 1, size=(2, _SAMPLES))
        a, b, c = self.points[order[np.vstack([first, others]) % len(order)]]
        normals = np.cross(b - a, c - a)
        lengths = np.linalg.norm(normals, axis=1)
        normals /= np.maximum(lengths, 1e-12)[:, None]
        offsets = np.sum(normals * a, axis=1)
        planes = map(Plane, normals, offsets)
        usable = (lengths > 1e-4) & [kind_of(plane, self.search) != OBLIQUE for plane in planes]
        return normals[usable], offsets[usable]

    def _support(self, points: Floats, normals: Floats, offsets: Floats) -> NDArray[np.intp]:
        counts = np.zeros(len(normals), dtype=np.intp)
        steep = np.linalg.norm(points, axis=1) * self.search.least_cosine
        for at in range(0, len(normals), _PLANES_AT_A_TIME):
            part = slice(at, at + _PLANES_AT_A_TIME)
            away = np.abs(np.einsum("ki,ni->kn", normals[part], points) - offsets[part, None])
            near = (away < self.search.threshold_m) & (steep <= np.abs(offsets[part, None]))
            counts[part] = np.count_nonzero(near, axis=1)
        return counts


def _of_full_lasers(laser: NDArray[np.int16], rows: Mask, share: float) -> Mask:
    returns = np.bincount(laser[rows], minlength=int(laser.max()) + 1)
    usual = np.median(returns[returns > 0]) if rows.any() else 0.0
    full: Mask = (returns >= share * usual)[laser]
    return full


def _extents(points: Floats, plane: Plane) -> tuple[float, float]:
    if len(points) == 0:
        return 0.0, 0.0
    width, height = np.ptp(plane_coordinates(points, plane, np.zeros(3)), axis=0)
    return float(width), float(height)
