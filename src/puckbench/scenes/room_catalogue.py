from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from puckbench.scenes import furniture_groups as groups
from puckbench.scenes.furniture import fixtures, seating, small, storage, tables
from puckbench.scenes.placement import Maker, Placement
from puckbench.scenes.shell import Opening, window


@dataclass(frozen=True)
class RoomSpec:
    """Specification of a room, in metres.

    ``outline`` has the counter-clockwise corners of the floor, ``origin`` is a sensor position free
    of furniture, and ``lamps`` holds the function that makes ceiling lamps, and their spacing.
    """

    kind: str
    outline: tuple[tuple[float, float], ...]
    height: float
    origin: tuple[float, float]
    openings: tuple[Opening, ...]
    furnishing: tuple[Placement, ...]
    lamps: tuple[Maker, float] = (fixtures.panel_lamp, 1.8)

    @property
    def size(self) -> tuple[float, float, float]:
        x, y = np.ptp(np.array(self.outline), axis=0).tolist()
        return x, y, self.height


def _box(x: float, y: float) -> tuple[tuple[float, float], ...]:
    return ((0.0, 0.0), (x, 0.0), (x, y), (0.0, y))


def _walled(*makers: Maker) -> tuple[Placement, ...]:
    return tuple(Placement(maker) for maker in makers)


def _hung(*makers: Maker) -> tuple[Placement, ...]:
    return tuple(Placement(maker, "mounted") for maker in makers)


def _loose(*makers: Maker) -> tuple[Placement, ...]:
    return tuple(Placement(maker, "floor") for maker in makers)


def _overhead(maker: Maker, x: float, y: float, turn: float = 0.0) -> Placement:
    return Placement(maker, "ceiling", at=(x, y), turn=turn)


def _pipe(height: float, *points: tuple[float, float, float]) -> Placement:
    return Placement(partial(fixtures.pipe_run, points=points), "fixed", at=(0.0, 0.0, height))


def _beam(length: float, x: float, y: float, height: float, depth: float = 0.3) -> Placement:
    return Placement(partial(fixtures.beam, length=length, depth=depth), "fixed", at=(x, y, height))


_RADIATOR = partial(fixtures.radiator, width=1.0)
_BOARD = partial(fixtures.whiteboard, width=1.6)
_WIDE_BOARD = partial(fixtures.whiteboard, width=2.6)
_NARROW_CASE = partial(storage.bookcase, width=0.6)
_LOW_CASE = partial(storage.bookcase, levels=3)
_WIDE_RACK = partial(storage.rack, width=1.5)
_COLUMN = {
    h: (partial(fixtures.round_column, height=h), partial(fixtures.square_column, height=h))
    for h in (2.7, 3.0, 3.1, 3.4, 4.8)
}

ROOMS: dict[str, RoomSpec] = {
    "office_1": RoomSpec(
        "office",
        _box(4.8, 3.6),
        2.8,
        (2.4, 1.3),
        (Opening(0, 0.5), window(2, 0.3), window(2, 0.72)),
        (
            Placement(groups.workstation, at=(1, 0.32)),
            Placement(groups.workstation, at=(3, 0.68)),
            Placement(_RADIATOR, "mounted", at=(2, 0.5)),
            *_walled(storage.bookcase, storage.cabinet),
            *_hung(_BOARD, fixtures.clock, fixtures.coat_rack, fixtures.light_switch),
            *_loose(groups.random_plant, small.waste_bin, small.carton_stack, small.ball),
        ),
    ),
    "office_2": RoomSpec(
        "office",
        _box(3.2, 5.0),
        2.7,
        (1.6, 2.3),
        (Opening(0, 0.25), window(2, 0.5, 2.0)),
        (
            Placement(groups.workstation, at=(1, 0.3)),
            Placement(_RADIATOR, "mounted", at=(2, 0.5)),
            *_walled(storage.bookcase, _NARROW_CASE, storage.sideboard, groups.random_plant),
            *_hung(fixtures.pinboard, fixtures.picture, fixtures.light_switch),
            *_loose(seating.shell_chair, small.waste_bin, small.carton_stack),
        ),
    ),
    "office_3": RoomSpec(
        "office",
        _box(10.4, 7.0),
        3.0,
        (5.2, 3.4),
        (
            Opening(0, 0.9),
            Opening(3, 0.2, "passage"),
            window(2, 0.15),
            window(2, 0.4),
            window(2, 0.63),
            window(2, 0.87),
        ),
        (
            Placement(_COLUMN[3.0][0], "floor", at=(3.4, 3.5), turn_range=0),
            Placement(_COLUMN[3.0][1], "floor", at=(7.0, 3.5), turn_range=0),
            *(
                Placement(groups.facing_workstations, "floor", at=(x, 5.1), turn=90)
                for x in (1.8, 5.2, 8.6)
            ),
            *(
                Placement(groups.facing_workstations, "floor", at=(x, 1.8), turn=90)
                for x in (3.4, 8.0)
            ),
            *(Placement(_RADIATOR, "mounted", at=(2, s)) for s in (0.15, 0.4, 0.63, 0.87)),
            _overhead(partial(fixtures.duct, length=9.0), 5.2, 4.0),
            *_walled(
                storage.bookcase,
                storage.bookcase,
                storage.cabinet,
                storage.sideboard,
                storage.copier,
            ),
            *_hung(_BOARD, fixtures.clock, fixtures.extinguisher, fixtures.pinboard),
            *_loose(
                groups.random_plant,
                groups.random_plant,
                small.waste_bin,
                small.waste_bin,
                small.carton_stack,
            ),
        ),
        (fixtures.tube_lamp, 1.9),
    ),
    "office_4": RoomSpec(
        "office",
        ((0, 0), (6.4, 0), (6.4, 3.2), (3.4, 3.2), (3.4, 5.6), (0, 5.6)),
        2.9,
        (2.5, 1.5),
        (Opening(0, 0.85), window(5, 0.3), window(5, 0.7), window(1, 0.5)),
        (
            Placement(groups.workstation, at=(4, 0.4)),
            Placement(groups.workstation, at=(0, 0.36)),
            Placement(groups.cafe_group, "floor", at=(1.25, 2.7)),
            *(Placement(_RADIATOR, "mounted", at=(5, s)) for s in (0.3, 0.7)),
            *_walled(storage.bookcase, storage.cabinet, _LOW_CASE, groups.random_plant),
            *_hung(fixtures.picture, _BOARD, fixtures.wall_shelf, fixtures.light_switch),
            *_loose(small.waste_bin, small.carton_stack, groups.balls),
        ),
    ),
    "meeting_room_1": RoomSpec(
        "meeting_room",
        _box(5.6, 4.2),
        2.8,
        (1.0, 2.1),
        (Opening(0, 0.85), window(2, 0.3, 1.6), window(2, 0.7, 1.6)),
        (
            Placement(groups.meeting_group, "floor", at=(3.3, 2.1)),
            Placement(_WIDE_BOARD, "mounted", at=(1, 0.5)),
            *(Placement(_RADIATOR, "mounted", at=(2, s)) for s in (0.3, 0.7)),
            _overhead(fixtures.projector, 2.4, 2.1, 90),
            *_walled(storage.sideboard, groups.random_plant),
            *_hung(fixtures.clock, fixtures.picture, fixtures.light_switch),
            *_loose(small.waste_bin, seating.chair),
        ),
    ),
    "conference_room_1": RoomSpec(
        "conference_room",
        _box(8.6, 5.4),
        3.1,
        (1.3, 2.7),
        (
            Opening(0, 0.9, width=1.4),
            Opening(0, 0.08, "passage"),
            window(2, 0.2, 1.8),
            window(2, 0.5, 1.8),
            window(2, 0.8, 1.8),
        ),
        (
            Placement(partial(groups.meeting_group, length=4.4, width=1.5), "floor", at=(4.7, 2.7)),
            Placement(partial(fixtures.projection_screen, width=2.6), "mounted", at=(1, 0.5)),
            Placement(_COLUMN[3.1][1], "floor", at=(0.5, 5.0), turn_range=0),
            Placement(_COLUMN[3.1][1], "floor", at=(8.1, 5.0), turn_range=0),
            *(Placement(_RADIATOR, "mounted", at=(2, s)) for s in (0.2, 0.5, 0.8)),
            _overhead(fixtures.projector, 3.4, 2.7, 90),
            *_walled(storage.sideboard, storage.water_cooler),
            *_hung(
                _BOARD, fixtures.picture, fixtures.picture, fixtures.clock, fixtures.extinguisher
            ),
            *_loose(groups.random_plant, groups.random_plant, groups.lectern, small.waste_bin),
        ),
        (fixtures.pendant_lamp, 2.1),
    ),
    "hallway_1": RoomSpec(
        "hallway",
        _box(16.0, 1.8),
        2.7,
        (8.0, 0.9),
        (
            *(Opening(0, s) for s in (0.12, 0.37, 0.63, 0.9)),
            Opening(2, 0.25),
            Opening(2, 0.75, "passage"),
            Opening(1, 0.5, width=1.2),
        ),
        (
            _overhead(partial(fixtures.duct, length=14.0), 8.0, 0.5),
            _pipe(2.7, (0.5, 1.4, -0.12), (9.6, 1.4, -0.12), (9.6, 1.6, -0.12), (15.5, 1.6, -0.12)),
            *_hung(
                fixtures.extinguisher,
                fixtures.pinboard,
                fixtures.pinboard,
                fixtures.picture,
                fixtures.picture,
                fixtures.coat_rack,
                fixtures.light_switch,
                fixtures.clock,
            ),
            *_walled(
                _NARROW_CASE,
                storage.water_cooler,
                seating.chair,
                seating.chair,
                groups.random_plant,
                small.waste_bin,
                small.carton_stack,
            ),
        ),
        (fixtures.smoke_detector, 2.4),
    ),
    "hallway_2": RoomSpec(
        "hallway",
        _box(2.7, 9.6),
        2.9,
        (1.2, 4.8),
        (
            Opening(1, 0.15),
            Opening(1, 0.55),
            Opening(3, 0.3, "passage"),
            Opening(3, 0.8),
            window(2, 0.5),
        ),
        (
            Placement(partial(storage.lockers, columns=6), at=(1, 0.36)),
            Placement(storage.lockers, at=(1, 0.8)),
            _pipe(2.9, (0.25, 0.3, -0.2), (0.25, 9.2, -0.2), (0.25, 9.2, -2.6)),
            _pipe(2.9, (0.45, 0.3, -0.2), (0.45, 8.4, -0.2), (2.4, 8.4, -0.2)),
            *_hung(
                fixtures.extinguisher,
                fixtures.pinboard,
                fixtures.clock,
                fixtures.picture,
                _RADIATOR,
            ),
            *_walled(seating.stool, seating.shell_chair, groups.random_plant, small.waste_bin),
        ),
        (fixtures.tube_lamp, 2.4),
    ),
    "hallway_3": RoomSpec(
        "hallway",
        ((0, 0), (11.0, 0), (11.0, 7.5), (8.9, 7.5), (8.9, 2.1), (0, 2.1)),
        2.7,
        (8.0, 1.05),
        (
            *(Opening(0, s) for s in (0.2, 0.55, 0.85)),
            Opening(4, 0.4, "passage"),
            Opening(1, 0.7),
            window(5, 0.5),
            window(2, 0.5, 1.2),
            Opening(3, 0.5),
        ),
        (
            Placement(seating.sofa, at=(4, 0.75)),
            Placement(storage.lockers, at=(1, 0.35)),
            *_hung(fixtures.extinguisher, fixtures.picture, fixtures.picture, fixtures.pinboard),
            *_walled(
                storage.copier,
                groups.random_plant,
                groups.random_plant,
                small.waste_bin,
                seating.chair,
                seating.chair,
                storage.cabinet,
            ),
        ),
        (fixtures.ceiling_diffuser, 2.2),
    ),
    "storage_1": RoomSpec(
        "storage",
        _box(3.6, 3.3),
        3.1,
        (1.8, 1.5),
        (Opening(0, 0.5),),
        (
            _pipe(3.1, (0.2, 0.2, -0.15), (0.2, 3.1, -0.15), (3.4, 3.1, -0.15), (3.4, 3.1, -2.9)),
            Placement(_WIDE_RACK, at=(1, 0.35)),
            Placement(storage.rack, at=(3, 0.5)),
            *_walled(_WIDE_RACK, storage.rack),
            *_walled(
                small.carton_stack,
                small.carton_stack,
                storage.drum,
                storage.gas_cylinder,
                small.bucket,
            ),
            *_loose(
                small.carton_stack, small.carton_stack, storage.ladder, groups.balls, small.bucket
            ),
        ),
        (fixtures.tube_lamp, 1.9),
    ),
    "storage_2": RoomSpec(
        "storage",
        _box(7.2, 4.0),
        3.4,
        (3.5, 2.0),
        (Opening(0, 0.8, width=1.6, height=2.3), Opening(3, 0.3), window(1, 0.5, 1.2, 0.6, 2.3)),
        (
            Placement(_COLUMN[3.4][1], "floor", at=(5.4, 1.2), turn_range=0),
            _overhead(partial(fixtures.duct, length=6.5, round_=False), 3.6, 2.0),
            *_walled(
                _WIDE_RACK, _WIDE_RACK, _WIDE_RACK, storage.rack, storage.rack, tables.workbench
            ),
            *_walled(
                storage.drum, storage.drum, storage.drum, storage.gas_cylinder, storage.gas_cylinder
            ),
            *_loose(
                storage.ladder, *(small.carton_stack,) * 5, groups.balls, storage.drum, small.bucket
            ),
        ),
        (fixtures.tube_lamp, 2.0),
    ),
    "copy_room_1": RoomSpec(
        "copy_room",
        _box(3.3, 3.0),
        2.7,
        (1.5, 1.3),
        (Opening(0, 0.25), window(2, 0.5, 1.0)),
        (
            *_walled(
                storage.copier, tables.workbench, storage.cabinet, _LOW_CASE, groups.random_plant
            ),
            *_hung(fixtures.pinboard, fixtures.clock, fixtures.wall_shelf, fixtures.light_switch),
            *_loose(small.carton_stack, small.carton_stack, small.waste_bin, small.papers),
        ),
    ),
    "lounge_1": RoomSpec(
        "lounge",
        _box(6.8, 5.6),
        3.0,
        (3.7, 2.8),
        (Opening(0, 0.85), window(2, 0.25, 2.0), window(2, 0.7, 2.0), window(1, 0.5)),
        (
            Placement(groups.seating_group, at=(3, 0.5)),
            Placement(groups.cafe_group, "floor", at=(5.5, 4.2)),
            Placement(groups.cafe_group, "floor", at=(5.4, 1.6)),
            Placement(_COLUMN[3.0][0], "floor", at=(3.7, 4.6), turn_range=0),
            *(Placement(_RADIATOR, "mounted", at=(2, s)) for s in (0.25, 0.7)),
            *_walled(
                storage.bookcase, _LOW_CASE, partial(seating.sofa, seats=2), groups.random_plant
            ),
            *_hung(fixtures.picture, fixtures.picture, fixtures.clock, fixtures.wall_shelf),
            *_loose(groups.random_plant, partial(seating.sofa, seats=1), small.ball, small.vase),
        ),
        (fixtures.pendant_lamp, 2.4),
    ),
    "pantry_1": RoomSpec(
        "pantry",
        _box(3.4, 4.4),
        2.7,
        (1.5, 1.6),
        (Opening(0, 0.7), window(2, 0.5, 1.5)),
        (
            Placement(storage.kitchenette, at=(1, 0.6)),
            Placement(storage.fridge, at=(1, 0.2)),
            Placement(groups.cafe_group, "floor", at=(1.4, 3.2)),
            *_walled(storage.water_cooler, storage.cabinet, small.waste_bin),
            *_hung(fixtures.clock, fixtures.wall_shelf, fixtures.picture, fixtures.extinguisher),
            *_loose(seating.stool, small.bucket, groups.random_plant),
        ),
        (fixtures.pendant_lamp, 1.7),
    ),
    "gallery_1": RoomSpec(
        "gallery",
        _box(7.0, 6.4),
        3.4,
        (3.5, 3.2),
        (Opening(0, 0.5, "passage", width=1.6, height=2.4), Opening(3, 0.35)),
        (
            *(
                Placement(_COLUMN[3.4][0], "floor", at=(x, y), turn_range=0)
                for x in (2.1, 4.9)
                for y in (1.9, 4.5)
            ),
            *(
                Placement(fixtures.plinth, "floor", at=(x, y), turn=a)
                for x, y, a in (
                    (1.0, 1.2, 10),
                    (6.0, 1.2, 0),
                    (1.0, 3.3, 0),
                    (6.0, 3.3, 20),
                    (1.0, 5.3, 0),
                    (3.5, 5.3, 5),
                    (6.0, 5.3, 0),
                )
            ),
            *(_beam(6.9, 3.5, y, 3.4) for y in (1.9, 4.5)),
            *_hung(*(fixtures.picture,) * 6, fixtures.extinguisher),
            *_loose(seating.stool, groups.random_plant, groups.balls),
        ),
        (fixtures.ceiling_diffuser, 2.4),
    ),
    "auditorium_1": RoomSpec(
        "auditorium",
        _box(10.0, 11.5),
        4.8,
        (5.0, 2.6),
        (
            Opening(1, 0.93, "passage", width=1.4, height=2.3),
            Opening(3, 0.07, width=1.4, height=2.3),
            window(3, 0.35, 1.8, 1.2, 2.9),
            window(3, 0.65, 1.8, 1.2, 2.9),
        ),
        (
            Placement(
                partial(groups.stepped_floor, width=9.98, step=(1.05, 0.26), count=6, at_back=1.6),
                "fixed",
                at=(5.0, 11.49, 0.0),
            ),
            *(
                Placement(
                    partial(groups.auditorium_row, count=6),
                    "floor",
                    at=(x, 5.29 + 1.05 * k, 0.26 * k + 0.26),
                    turn_range=0,
                )
                for k in range(6)
                for x in (2.6, 7.4)
            ),
            Placement(_WIDE_BOARD, "mounted", at=(0, 0.27)),
            Placement(partial(fixtures.projection_screen, width=4.0), "mounted", at=(0, 0.62)),
            Placement(groups.lectern, "floor", at=(2.0, 1.6), turn=180),
            Placement(tables.workbench, "floor", at=(7.2, 1.4)),
            Placement(seating.chair, "floor", at=(7.2, 0.8), turn=180),
            *(Placement(_COLUMN[4.8][0], "floor", at=(x, 4.3), turn_range=0) for x in (0.5, 9.5)),
            *(_beam(9.9, 5.0, y, 4.8, 0.4) for y in (4.3, 9.2)),
            _overhead(fixtures.projector, 5.0, 6.9, 0),
            Placement(fixtures.extinguisher, "mounted", at=(0, 0.87)),
            Placement(fixtures.clock, "mounted", at=(0, 0.105)),
            *(
                Placement(groups.random_plant, "floor", at=place)
                for place in ((0.8, 3.2), (9.2, 3.2))
            ),
        ),
        (fixtures.tube_lamp, 2.4),
    ),
}
