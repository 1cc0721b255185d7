"""From points to a stream: smoothed samples, a pruned tree of planes, bitmaps."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from puckbench.cloud import Floats
from puckbench.codecs.primitives.columns import Choice
from puckbench.codecs.primitives.decoder import empty_leaves, frame_of
from puckbench.codecs.primitives.entropy import writer, written
from puckbench.codecs.primitives.layout import Bytes, Frame, Leaves, Nodes
from puckbench.codecs.primitives.noise import spread
from puckbench.codecs.primitives.settings import SIZE, Settings
from puckbench.codecs.primitives.smooth import sampled, smoothed
from puckbench.codecs.primitives.stream import MOST_CELLS, Header, pack_surface
from puckbench.codecs.primitives.support import CONTEXTS, MIXERS, code_support
from puckbench.codecs.primitives.surface import count_points
from puckbench.codecs.primitives.tree import Level, build, prune
from puckbench.codecs.primitives.walk import code_tree
from puckbench.metrics.spatial import morton_order

_NOISE_CELL = 16.0
_SAMPLE_CELL = 6.0
_FEWEST_A_SAMPLE = 3.0
_BAND = 6.5
"""Tukey's band of smoothing, in standard deviations of the noise."""
_DISC = 0.6
"""Radius of the disc that a sample stands for, in sample cells."""
_LEAF_BITS, _SPLIT_BITS = 9.0, 5.0
_EDGE_BITS = 3.0
_MISSING, _ACROSS, _MOST = 20.0, 0.1, 100.0
_MISSING_CELL = 0.3
_BYTES_A_NODE = 64
_MARGIN = 0.5
"""Cells between the least coordinate and the grid's edge: smoothing moves samples."""
_POINT_SPACING = 4.0
_FARTHEST = 16


class Surface(NamedTuple):
    """Samples on the surface: xyz, normals (n, 3), counts (n,), side of their cells."""

    xyz: Floats
    normals: Floats
    counts: Floats
    cell: float


def encode_surface(points: Floats, settings: Settings) -> bytes | None:
    """Code points (n, 3) as planes; None where there are too few points for that."""
    points = points[morton_order(points)]
    low, unit = points.min(axis=0), float(np.ptp(points, axis=0).max()) / SIZE
    points = (points - low) / unit
    noise = spread(points, _NOISE_CELL)
    settings = settings.coarsened(noise)
    surface = _surface(points, noise, settings)
    cell = _cell(surface, settings)
    surface = _in_cells(surface, cell)
    header, levels = _plan(surface, settings, cell)
    frame = frame_of(header, settings.price / cell**2 / len(points))
    prune(levels, frame.price, _LEAF_BITS, _SPLIT_BITS, frame.coarsest, frame.finest)
    leaves, owner, cover = empty_leaves(header)
    coder = writer(CONTEXTS, MIXERS, 4096 + _BYTES_A_NODE * header.leaves)
    code_tree(coder, frame, _nodes(levels), leaves, owner)
    choice = _choice(surface, frame, cell)
    code_support(coder, frame, leaves, owner, choice, cover)
    density = _density(frame, leaves, cover, len(points), cell)
    if density is None:
        return None
    origin = low - _MARGIN * cell * unit
    placed = header._replace(
        origin=origin, unit=cell * unit, fineness=density[0], spread=density[1]
    )
    return pack_surface(placed, written(coder))


def noise_of(points: Floats, unit: float) -> float:
    """Standard deviation of the noise of points (n, 3), in units of side `unit`."""
    return spread((points - points.min(axis=0)) / unit, _NOISE_CELL)


def _surface(points: Floats, noise: float, settings: Settings) -> Surface:
    """Smoothed samples of points in units; their cells grow until they hold a few points each."""
    side = min(_SAMPLE_CELL, 1.5 * settings.cell)
    samples = sampled(points, side)
    while len(points) < _FEWEST_A_SAMPLE * len(samples.xyz) and side < SIZE / 4:
        side *= 2**0.5
        samples = sampled(points, side)
    radius = max(settings.reach * noise, 1.5 * side)
    xyz, normals = smoothed(samples, side, radius, max(_BAND * noise, side / 2))
    return Surface(xyz, normals, samples.counts, side)


def _cell(surface: Surface, settings: Settings) -> float:
    """Side of a bitmap's column: samples that lie apart cannot say more than their spacing does."""
    finer = np.log2(0.6 * surface.cell / settings.cell)
    cell = settings.cell * 2.0 ** max(0, np.ceil(finer - 1e-9))
    while np.prod(np.ptp(surface.xyz, axis=0) / cell + 2) > MOST_CELLS:
        cell *= 2
    return float(cell)


def _in_cells(surface: Surface, cell: float) -> Surface:
    xyz = surface.xyz / cell + _MARGIN
    return surface._replace(xyz=np.maximum(xyz, 0.0), cell=surface.cell / cell)


def _plan(surface: Surface, settings: Settings, cell: float) -> tuple[Header, list[Level]]:
    """Header without place and density, and the tree."""
    shape = np.floor(surface.xyz.max(axis=0)).astype(np.int64) + 1
    depth = int(np.ceil(np.log2(shape.max())))
    finest = max(depth - round(np.log2(max(settings.leaf / cell, 1))), 0)
    coarsest = max(depth - round(np.log2(max(settings.largest / cell, 1))), 0)
    weights = surface.counts / surface.counts.sum() / 2 + 0.5 / len(surface.counts)
    radius = _DISC * surface.cell
    levels = build(surface.xyz, surface.normals, weights, radius, depth)
    step = min(max(round(16 * settings.step / cell), 1), 255)
    x, y, z = shape.tolist()
    room = len(levels[finest].cells) + 8
    coarsest = min(max(coarsest, depth - 8), finest)
    place = (np.zeros(3), 1.0, (x, y, z))
    return Header(*place, depth, finest, coarsest, step, 1, 1, room), levels


def _nodes(levels: list[Level]) -> Nodes:
    """The tree's levels in one list."""
    starts = np.cumsum([0] + [len(level.cells) for level in levels])
    first = [level.first[:-1] + start for level, start in zip(levels, starts[1:], strict=True)]
    cells = np.concatenate([level.cells for level in levels]) & 1
    return Nodes(
        np.concatenate([level.moments for level in levels]),
        np.concatenate([*first, starts[-1:]]),
        np.concatenate([level.leaf for level in levels]),
        cells @ np.array([4, 2, 1]),
    )


def _choice(surface: Surface, frame: Frame, cell: float) -> Choice:
    cells = np.floor(surface.xyz / surface.cell).astype(np.int64)
    rows = np.zeros(cells.max(axis=0) + 1, np.int32)
    rows[tuple(cells.T)] = np.arange(1, len(cells) + 1)
    return Choice(
        surface.xyz,
        surface.normals,
        surface.counts / surface.counts.sum() / 2,
        rows,
        cell=surface.cell,
        across=_ACROSS,
        most=_MOST / cell**2,
        missing=max(_MISSING / cell**2, _MISSING_CELL),
        area=0.5 / len(surface.counts),
        edge=_EDGE_BITS * frame.price,
    )


def _density(
    frame: Frame, leaves: Leaves, cover: Bytes, most: int, cell: float
) -> tuple[int, int] | None:
    """Points across a column and columns between points: no more than `most`; None if none fit."""
    fineness, spacing = min(max(round(cell / _POINT_SPACING), 1), 16), 1
    while (made := count_points(frame, leaves, cover, fineness, spacing)) > most:
        if fineness > 1:
            fineness -= 1
        elif spacing < _FARTHEST:
            spacing += 1
        else:
            return None
    return (fineness, spacing) if made else None
