"""From points to a stream: smoothed samples, a pruned tree of planes, bitmaps."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.codecs.common.binary_coder import written
from puckbench.codecs.primitives.columns import Choice
from puckbench.codecs.primitives.decoder import Patches, empty_leaves, frame_of
from puckbench.codecs.primitives.detect import detected
from puckbench.codecs.primitives.entropy import writer
from puckbench.codecs.primitives.layout import Bytes, Frame, Ints, Leaves, Nodes
from puckbench.codecs.primitives.manhattan_frame import Turn, rotation
from puckbench.codecs.primitives.noise import spread
from puckbench.codecs.primitives.regions import Limits, wholes
from puckbench.codecs.primitives.revolved import (
    CONTEXTS,
    MIXERS,
    Round,
    code_round,
    packed,
    unpacked,
)
from puckbench.codecs.primitives.revolved_support import Prices, Wrapped, placed, wrapped
from puckbench.codecs.primitives.settings import SIZE, Settings
from puckbench.codecs.primitives.smooth import sampled, smoothed
from puckbench.codecs.primitives.stream import MOST_CELLS, MOST_ROUND_POINTS, Header, pack_surface
from puckbench.codecs.primitives.support import code_support
from puckbench.codecs.primitives.surface import count_points
from puckbench.codecs.primitives.traversal import code_tree
from puckbench.codecs.primitives.tree import Level, build, leaves_of, prune
from puckbench.geometry.cloud import Floats
from puckbench.geometry.spatial_order import morton_order

_NOISE_CELL = 16.0
_SAMPLE_CELL = 6.0 / 2**0.5
"""Side of a sample's cell, in units, where there are points enough."""
_SAMPLE_NOISE = 3.0
"""Side of a sample's cell, in standard deviations of the noise: no less for finer columns."""
_FEWEST_A_SAMPLE = 2.5
"""Points in a sample's cell, on average, at least."""
_BAND = 6.5
"""Tukey's band of smoothing, in standard deviations of the noise."""
_DISC = 0.6
"""Radius of the disc that a sample stands for, in sample cells."""
_LEAF_BITS, _SPLIT_BITS = 6.0, 5.0
_EDGE_BITS = 3.0
_REGION_BITS = 25.0
"""Bits that leaves of one plane instead of two are taken to save."""
_WITHIN_NOISE = 1.0
"""Squared distance, in squares of the noise, that a region may grow by for each of its points."""
_FLAT = 0.5
"""Cosine of the angle between planes of a region, at least."""
_FLOOR = 3.0
"""Squared error, in squares of the noise, that a bit for edges and regions has to save: smoothing
leaves so much of the noise that cheaper ones would code it."""
_MISSING, _ACROSS, _MOST = 20.0, 0.1, 100.0
_MISSING_CELL = 0.3
_BYTES_A_NODE = 64
_TOLERANCE, _TOLERANCE_NOISE = 0.3, 0.5
"""Distance of samples from a round surface that they lie on, in cells and noise's deviations."""
_KEPT = 16
"""Samples, about, that are left to planes whatever round surfaces have."""
_POINT_SPACING = 2.0
_FARTHEST = 16


class Surface(NamedTuple):
    """Samples on the surface: xyz, normals (n, 3), shares (n,) of the points, side of their cells.

    area: a sample's share of the area.
    """

    xyz: Floats
    normals: Floats
    shares: Floats
    cell: float
    area: float

    def only(self, rows: NDArray[np.bool_]) -> Surface:
        """Some of the samples, their shares as they are."""
        chosen = (self.xyz[rows], self.normals[rows], self.shares[rows])
        return Surface(*chosen, self.cell, self.area)


class Way(NamedTuple):
    """A way to code a surface: a turn of the axes, where the grid lies, round surfaces.

    margins: cells between the grid's least corner and the surface's, along each axis.
    """

    turn: Turn = (0, 0, 0)
    margins: tuple[float, float, float] = (0.5, 0.5, 0.5)
    rounds: tuple[Round, ...] = ()


class Cloud(NamedTuple):
    """A cloud in units: points (n, 3) in Morton order, its least corner and a unit, settings."""

    points: Floats
    low: Floats
    unit: float
    noise: float
    surface: Surface
    settings: Settings

    def in_units(self, points: Floats) -> Floats:
        """Points (m, 3) of the cloud's coordinates in units."""
        return np.asarray((points - self.low) / self.unit)


class Coded(NamedTuple):
    """A stream, and what its decoder reads from it."""

    stream: bytes
    patches: Patches


def prepared(points: Floats, settings: Settings) -> Cloud:
    """Scale points (n, 3) to units and smooth their surface."""
    points = points[morton_order(points)]
    low, unit = points.min(axis=0), float(np.ptp(points, axis=0).max()) / SIZE
    points = (points - low) / unit
    noise = spread(points, _NOISE_CELL)
    settings = settings.coarsened(noise)
    return Cloud(points, low, unit, noise, _surface(points, noise, settings), settings)


def round_surfaces(cloud: Cloud) -> tuple[Round, ...]:
    """Cylinders, cones and spheres of a cloud, in units."""
    surface = cloud.surface
    found = detected(surface.xyz, surface.normals, surface.cell, _tolerance(cloud))
    return tuple(found)


def margins_of_points(cloud: Cloud) -> tuple[float, float, float]:
    """Margins of a grid from the points' least corner on, off which noise keeps outer walls."""
    low = np.maximum(cloud.surface.xyz.min(axis=0), 0)
    x, y, z = (0.5 + low / cell_of(cloud)).tolist()
    return (x, y, z)


def cell_of(cloud: Cloud) -> float:
    """Side of a bitmap's column along the cloud's own axes, in units."""
    return _cell(cloud.surface, cloud.settings)


def encode_surface(cloud: Cloud, way: Way) -> Coded | None:
    """Code a cloud as planes and round surfaces; None where there are too few points for that."""
    points, settings = cloud.points, cloud.settings
    surface, low = _turned(cloud, way.turn)
    cell = _cell(surface, settings)
    surface = _in_cells(surface, cell, way.margins)
    rounds = [placed(each, rotation(way.turn), low, cell, way.margins) for each in way.rounds]
    wraps, surface = _wrapped(rounds, surface, cloud, cell)
    header, levels = _plan(surface, settings, cell)
    frame = frame_of(header, settings.price / cell**2 / len(points))
    prune(levels, frame.price, _LEAF_BITS, _SPLIT_BITS, frame.coarsest, frame.finest)
    leaves, owner, cover = empty_leaves(header)
    noise = (cloud.noise / cell) ** 2
    dear = max(frame.price, _FLOOR * noise / len(points))
    limits = Limits(_REGION_BITS * dear, _WITHIN_NOISE * noise, _FLAT)
    coder = writer(CONTEXTS, MIXERS, 4096 + _BYTES_A_NODE * header.leaves + _room(wraps))
    code_tree(coder, frame, _nodes(levels, frame.shape, limits), leaves, owner)
    choice = _choice(surface, dear, cell)
    code_support(coder, frame, leaves, owner, choice, cover)
    for wrap in wraps:
        code_round(coder, wrap.surface.columns(), wrap.bits)
    columns = sum(int(wrap.bits.sum()) for wrap in wraps)
    density = _density(frame, leaves, cover, (columns, len(points)), cell)
    if density is None:
        return None
    header = _complete(header, cloud, way, low, density, cell, wraps)
    kept = [wrap.bits for wrap in wraps]
    patches = Patches(
        header, frame, leaves, cover, list(zip(unpacked(header.rounds), kept, strict=True))
    )
    return Coded(pack_surface(header, written(coder.bits)), patches)


def _surface(points: Floats, noise: float, settings: Settings) -> Surface:
    """Smoothed samples of points in units; their cells grow until they hold a few points each.

    Cells are the usual ones or 2^(k/2) times as large: no rate's are coarser than a lower one's.
    """
    least = max(1.5 * settings.cell, _SAMPLE_NOISE * noise)
    finer = np.log2(max(_SAMPLE_CELL / least, 1.0))
    side = float(_SAMPLE_CELL * 2.0 ** (-np.ceil(2 * finer - 1e-9) / 2))
    samples = sampled(points, side)
    while len(points) < _FEWEST_A_SAMPLE * len(samples.xyz) and side < SIZE / 4:
        side *= 2**0.5
        samples = sampled(points, side)
    radius = max(settings.reach * noise, 1.5 * side)
    xyz, normals = smoothed(samples, side, radius, max(_BAND * noise, side / 2))
    return Surface(xyz, normals, samples.counts / len(points), side, 1 / len(xyz))


def _tolerance(cloud: Cloud) -> float:
    return _TOLERANCE * cloud.settings.cell + _TOLERANCE_NOISE * cloud.noise


def _turned(cloud: Cloud, turn: Turn) -> tuple[Surface, Floats]:
    """The surface along other axes, from its least corner on, and where that is (3,)."""
    surface, turned = cloud.surface, rotation(turn)
    xyz = surface.xyz @ turned.T
    low = xyz.min(axis=0)
    return surface._replace(xyz=xyz - low, normals=surface.normals @ turned.T), low


def _wrapped(
    rounds: list[Round], surface: Surface, cloud: Cloud, cell: float
) -> tuple[list[Wrapped], Surface]:
    """Bitmaps of round surfaces, and the samples that are left to planes."""
    if not rounds:
        return [], surface
    missing = max(_MISSING / cell**2, _MISSING_CELL)
    price = cloud.settings.price / cell**2 / len(cloud.points)
    edge = _EDGE_BITS * price * surface.cell**2 / (surface.area / 2)
    most, tolerance = _MOST / cell**2, _tolerance(cloud) / cell
    prices = Prices(missing, _ACROSS, most, tolerance, surface.cell, edge)
    gain = surface.shares / surface.area
    wraps, left = wrapped(rounds, surface.xyz, surface.normals, gain, prices)
    left[:: -(-len(left) // _KEPT)] = True
    return wraps, surface.only(left)


def _room(wraps: list[Wrapped]) -> int:
    return sum(len(wrap.bits) for wrap in wraps) // 4


def _complete(
    header: Header,
    cloud: Cloud,
    way: Way,
    low: Floats,
    density: tuple[int, int],
    cell: float,
    wraps: list[Wrapped],
) -> Header:
    """The header with place, density and the round surfaces' parameters."""
    start = cloud.low @ rotation(way.turn).T + cloud.unit * (low - np.array(way.margins) * cell)
    return header._replace(
        origin=start,
        unit=cell * cloud.unit,
        turn=way.turn,
        rounds=b"".join(packed(wrap.surface) for wrap in wraps),
        fineness=density[0],
        spread=density[1],
    )


def _cell(surface: Surface, settings: Settings) -> float:
    """Side of a bitmap's column: samples that lie apart cannot say more than their spacing does."""
    finer = np.log2(0.6 * surface.cell / settings.cell)
    cell = settings.cell * 2.0 ** max(0, np.ceil(finer - 1e-9))
    while np.prod(np.ptp(surface.xyz, axis=0) / cell + 2) > MOST_CELLS:
        cell *= 2
    return float(cell)


def _in_cells(surface: Surface, cell: float, margins: tuple[float, float, float]) -> Surface:
    xyz = surface.xyz / cell + margins
    return surface._replace(xyz=np.maximum(xyz, 0.0), cell=surface.cell / cell)


def _plan(surface: Surface, settings: Settings, cell: float) -> tuple[Header, list[Level]]:
    """Header without place and density, and the tree."""
    shape = np.floor(surface.xyz.max(axis=0)).astype(np.int64) + 1
    depth = int(np.ceil(np.log2(shape.max())))
    finest = max(depth - round(np.log2(max(settings.leaf / cell, 1))), 0)
    coarsest = max(depth - round(np.log2(max(settings.largest / cell, 1))), 0)
    weights = surface.shares / 2 + surface.area / 2
    radius = _DISC * surface.cell
    levels = build(surface.xyz, surface.normals, weights, radius, depth)
    step = min(max(round(16 * settings.step / cell), 1), 255)
    x, y, z = shape.tolist()
    room = len(levels[finest].cells) + 8
    coarsest = min(max(coarsest, depth - 8), finest)
    place = (np.zeros(3), 1.0, (x, y, z))
    return Header(*place, depth, finest, coarsest, step, 1, 1, room), levels


def _nodes(levels: list[Level], shape: Ints, limits: Limits) -> Nodes:
    """The tree's levels in one list, and regions of its leaves; shape: of the grid of cells."""
    moments = np.concatenate([level.moments for level in levels])
    places, leaves = leaves_of(levels)
    regions = np.zeros_like(moments)
    regions[places] = wholes(moments[places], leaves, shape, limits)
    starts = np.cumsum([0] + [len(level.cells) for level in levels])
    first = [level.first[:-1] + start for level, start in zip(levels, starts[1:], strict=True)]
    cells = np.concatenate([level.cells for level in levels]) & 1
    return Nodes(
        moments,
        np.concatenate([*first, starts[-1:]]),
        np.concatenate([level.leaf for level in levels]),
        cells @ np.array([4, 2, 1]),
        regions,
    )


def _choice(surface: Surface, price: float, cell: float) -> Choice:
    cells = np.floor(surface.xyz / surface.cell).astype(np.int64)
    rows = np.zeros(cells.max(axis=0) + 1, np.int32)
    rows[tuple(cells.T)] = np.arange(1, len(cells) + 1)
    return Choice(
        surface.xyz,
        surface.normals,
        surface.shares / 2,
        rows,
        cell=surface.cell,
        across=_ACROSS,
        most=_MOST / cell**2,
        missing=max(_MISSING / cell**2, _MISSING_CELL),
        area=surface.area / 2,
        edge=_EDGE_BITS * price,
    )


def _density(
    frame: Frame, leaves: Leaves, cover: Bytes, counts: tuple[int, int], cell: float
) -> tuple[int, int] | None:
    """Points across a column and columns between points; None if none fit.

    counts: columns of round surfaces, and points that may be made in all.
    """
    fineness, spacing = min(max(round(cell / _POINT_SPACING), 1), 16), 1
    while True:
        made = count_points(frame, leaves, cover, fineness, spacing)
        of_rounds = counts[0] * fineness**2
        made += of_rounds // spacing**2
        if made <= counts[1] and of_rounds <= MOST_ROUND_POINTS:
            break
        if fineness > 1:
            fineness -= 1
        elif spacing < _FARTHEST:
            spacing += 1
        else:
            return None
    return (fineness, spacing) if made else None
