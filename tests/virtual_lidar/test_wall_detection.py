import re
from dataclasses import replace

import numpy as np
import pytest

from pointkit.errors import InputError
from pointkit.geometry.mesh import Mesh
from pointkit.lidar.return_table import ReturnTable
from pointkit.models import parsed
from tests.support.room_captures import NOISE, captured, room_scan
from tests.support.sensor_scenes import joined, moved, quad
from virtual_lidar.walls.detection import (
    DetectedPlane,
    PlaneSearch,
    Rejected,
    find_surfaces,
    incidence,
    kind_of,
    surface_of,
)

SEARCH = PlaneSearch()


def found(
    table: ReturnTable, search: PlaneSearch = SEARCH, seed: int = 0
) -> tuple[list[DetectedPlane], list[Rejected]]:
    return find_surfaces(table, search, np.random.default_rng(seed))


def field(size: float = 40.0) -> Mesh:
    return quad([-size, -size, 0], [2 * size, 0, 0], [0, 2 * size, 0])


@pytest.fixture(scope="module")
def clean() -> ReturnTable:
    return captured(room_scan(2))


@pytest.fixture(scope="module")
def noisy() -> ReturnTable:
    return captured(room_scan(4, noise=NOISE, seed=2))


def test_the_four_walls_of_a_room_are_found_where_they_are(clean: ReturnTable) -> None:
    surfaces, rejected = found(clean)
    assert not rejected
    assert [item.kind for item in surfaces] == ["wall"] * 4
    # The vertical correction of up to 11 mm moves points along upright walls.
    assert sorted(item.distance_m for item in surfaces) == pytest.approx([2.5, 2.5, 3, 3], abs=5e-4)
    for item in surfaces:
        # Distances come in steps of 2 mm.
        assert np.abs(item.plane.distances(clean.xyz[item.rows])).max() < 1.5e-3
        assert item.plane.normal @ clean.xyz[item.rows[0]] < 0


def test_returns_next_to_a_corner_do_not_count(clean: ReturnTable) -> None:
    corners = np.degrees([np.arctan2(x, y) for x in (-3.0, 3.0) for y in (-2.5, 2.5)]) % 360
    for item in found(clean)[0]:
        degrees = np.floor(np.degrees(clean["azimuth"][item.rows]))
        assert not np.isin(np.floor(corners), degrees).any()


def test_all_else_of_the_walls_counts(clean: ReturnTable) -> None:
    rows = np.concatenate([item.rows for item in found(clean)[0]])
    assert len(np.unique(rows)) == len(rows)
    # Up to three of 90 columns are cut off at each end of a wall.
    assert len(rows) > 0.93 * len(clean)


def test_noise_moves_the_walls_by_little(noisy: ReturnTable) -> None:
    distances = sorted(item.distance_m for item in found(noisy)[0])
    # The mean of 16 biases of 8 mm goes into the plane.
    assert distances == pytest.approx([2.5, 2.5, 3, 3], abs=3 * 0.008 / 4)


def test_the_same_generator_finds_the_same_planes_and_another_nearly(
    noisy: ReturnTable,
) -> None:
    first, again, other = found(noisy)[0], found(noisy)[0], found(noisy, seed=5)[0]
    for left, two in zip(first, again, strict=True):
        assert np.array_equal(left.rows, two.rows)
        assert left.plane.offset == two.plane.offset
    for left, two in zip(first, sorted(other, key=lambda left: -len(left.rows)), strict=True):
        assert left.distance_m == pytest.approx(two.distance_m, abs=1e-3)


def test_a_laser_with_a_great_bias_keeps_its_returns(noisy: ReturnTable) -> None:
    longer = noisy["distance"] + np.where(noisy["laser_id"] == 6, 0.028, 0.0)
    scaled = (longer / noisy["distance"])[:, None] * noisy.xyz
    columns = {**noisy.columns, "distance": longer, **dict(zip("xyz", scaled.T, strict=True))}
    table = replace(noisy, columns=columns)
    for item in found(table)[0]:
        counts = np.bincount(table["laser_id"][item.rows], minlength=16)
        assert counts[6] >= 0.95 * np.median(counts)


def test_a_laser_that_runs_along_an_edge_does_not_count(noisy: ReturnTable) -> None:
    ahead = (noisy["azimuth"] < 0.1) | (noisy["laser_id"] != 5)
    wall = found(noisy)[0][0]
    rows = wall.rows[ahead[wall.rows]]
    again = surface_of(noisy, rows, wall.plane, "wall", SEARCH)
    assert 5 in noisy["laser_id"][rows]
    assert set(noisy["laser_id"][again.rows]) == set(range(16)) - {5}


def test_the_rings_of_a_field_make_no_floor() -> None:
    """A level Puck meets the ground at 75 degrees or more, and with its level lasers never."""
    table = captured(room_scan(2, [0, 0, 1.0], mesh=field()))
    assert found(table) == ([], [])


def test_a_tilted_sensor_sees_a_floor_when_told_what_is_up() -> None:
    table = captured(room_scan(2, [0, 0, 1.0], mesh=field(5.0), pitch_deg=-40.0))
    tilt = np.radians(-40.0)
    surfaces, _ = found(table, PlaneSearch(up=(0.0, np.sin(tilt), np.cos(tilt))))
    assert [item.kind for item in surfaces] == ["floor"]
    # A decoder adds the vertical correction of up to 11 mm, which no virtual sensor has.
    assert surfaces[0].distance_m == pytest.approx(1.0, abs=0.012)
    assert found(table)[0] == []


def test_a_small_plane_is_not_taken_and_the_reason_told() -> None:
    board = moved(quad([-0.2, 0, -0.4], [0.4, 0, 0], [0, 0, 0.8]), [0, 1.5, 0])
    table = captured(room_scan(2, [0, 0, 0], mesh=joined([board, moved(field(), [0, 0, -1])])))
    # The lowest laser meets the floor at 75 degrees, the limit by default.
    surfaces, rejected = found(table, SEARCH.replaced(most_incidence_deg=70.0))
    assert not surfaces
    assert rejected[0].surface.distance_m == pytest.approx(1.5, abs=1e-3)
    assert rejected[0].reason.endswith("m wide")


def test_a_rough_wall_is_not_taken() -> None:
    rough = captured(room_scan(4, noise={**NOISE, "ray_sigma_m": 0.03}))
    surfaces, rejected = found(rough, PlaneSearch(threshold_m=0.1))
    assert not surfaces
    # 30 mm along rays that meet the walls at up to 50 degrees.
    assert all(re.match(r"rough, .* 2[5-9]\.\d mm", item.reason) for item in rejected)
    assert len(rejected) == 4


def test_incidence_is_measured_from_the_normal(clean: ReturnTable) -> None:
    for item in found(clean)[0]:
        rows = clean.select(item.rows)
        cosine = item.distance_m / rows["distance"]
        assert np.cos(incidence(rows, item.plane)) == pytest.approx(cosine, abs=1e-3)


@pytest.mark.parametrize(
    ("normal", "kind"),
    [
        ((1, 0, 0.1), "wall"),
        ((1, 0, 0.3), "oblique"),
        ((0, 0, 1), "floor"),
        ((0.1, 0, -1), "ceiling"),
    ],
)
def test_kinds_of_planes(normal: tuple[float, ...], kind: str) -> None:
    from pointkit.geometry.ransac import Plane

    unit = np.array(normal) / np.linalg.norm(normal)
    for side in (1, -1):
        assert kind_of(Plane(side * unit, -side * 2.0), SEARCH) == kind


@pytest.mark.parametrize(
    ("values", "fault"),
    [
        ({"threshold_m": 0.0}, "search: threshold_m is 0.0, but must be greater than 0"),
        ({"most_planes": 0}, "most_planes is 0"),
        ({"up": (0.0, 0.0, 0.0)}, "up must be a direction"),
    ],
)
def test_limits_that_make_no_sense_are_refused(values: dict[str, float], fault: str) -> None:
    with pytest.raises(InputError, match=fault):
        parsed(PlaneSearch, values, "search")
