"""Places where a sensor cannot stand, and those that only look like it."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike
from scipy.spatial.distance import pdist

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from pointkit.geometry.mesh import Labels, Mesh, SceneObject
from pointkit.lidar.sensors import load_sensor
from tests.support.sensor_scenes import box, joined, quad, room
from virtual_lidar import ScanJob, ScanTable, Sweep, open_error_model, open_sweep
from virtual_lidar.placement import _floor, _grid, check_free, check_untouched, seen_around

TURN = open_sweep({"preset": "spin", "azimuth_step_deg": 1.0})


@dataclass
class Around:
    """A ray caster's answers: distances in the 256 directions that are looked in, or to a wall."""

    distances: Floats
    origin: Floats = field(default_factory=lambda: np.zeros(3))
    surfaces: None = None
    directions: list[Floats] = field(default_factory=list)

    def met(self, starts: Floats, directions: Floats) -> tuple[Floats, Floats]:
        self.directions.append(directions)
        return self.distances[: len(directions)], np.zeros(len(directions), np.uint32)

    def clearances(self, places: Floats) -> Floats:
        return places[:, 0]


STAYS = (np.zeros(1), np.zeros((1, 3)))


@pytest.mark.parametrize(
    ("hits", "reach", "fault"),
    [
        (256, 1.0, ""),
        (256, 0.99, "is enclosed: it sees no farther than 0.99 m"),
        (129, np.inf, ""),
        (128, np.inf, "is outside the scene: 50% of all directions"),
    ],
)
def test_inside_is_where_most_directions_meet_something_and_one_metre_away(
    hits: int, reach: float, fault: str
) -> None:
    distances = np.where(np.arange(256) < hits, 0.5, np.inf)
    distances[-1] = reach
    caster: Any = Around(distances)
    if fault:
        with pytest.raises(InputError, match=fault):
            check_free(caster, *STAYS)
    else:
        check_free(caster, *STAYS)


def test_directions_are_spread_evenly_over_the_sphere() -> None:
    """256 caps of equal area on hexagons would be 0.24 apart."""
    caster: Any = Around(np.ones(256))
    seen_around(caster, np.zeros(3))
    (directions,) = caster.directions
    assert directions.shape == (256, 3)
    assert np.linalg.norm(directions, axis=1) == pytest.approx(1)
    assert directions.mean(axis=0) == pytest.approx(0, abs=0.01)
    assert directions.T @ directions / 256 == pytest.approx(np.eye(3) / 3, abs=0.01)
    assert pdist(directions).min() > 0.19


def test_a_millimetre_is_the_least_clearance() -> None:
    caster: Any = Around(np.ones(1))
    check_untouched(caster, np.array([[0.0011, 0, 0], [0.001, 0, 0]]))
    with pytest.raises(InputError, match=r"the sensor at \[0.0009, 0.0, 0.0\] touches the mesh"):
        check_untouched(caster, np.array([[0.5, 0, 0], [0.0009, 0, 0], [0.0001, 0, 0]]))


@pytest.mark.parametrize(
    ("size", "spacing"),
    [((4.12, 2.12, 9.0), 0.05), ((20.2, 6.5, 3.0), 0.202), ((6.5, 20.2, 3.0), 0.202)],
)
def test_spots_fill_the_floor_plan_the_nearest_to_its_middle_first(
    size: tuple[float, ...], spacing: float
) -> None:
    """At least 5 cm apart, and a hundredth of the longer side."""
    places = _grid(np.array(size))
    farthest = np.floor(np.array(size[:2]) / 2 / spacing + 1e-9) * spacing
    assert np.abs(places).max(axis=0) == pytest.approx([*farthest, 0])
    assert len(places) == np.prod(2 * np.rint(farthest / spacing) + 1)
    away = np.hypot(places[:, 0], places[:, 1])
    assert away[0] == 0
    assert (np.diff(away) >= 0).all()


def test_where_no_ray_ends_the_floor_is_taken_for_the_scenes_lower_end() -> None:
    caster: Any = Around(np.full(9, np.inf))
    assert _floor(caster, np.zeros((9, 3)), np.array([6.0, 5.0, 3.0])) == -1.5
    assert caster.directions[-1].tolist() == [[0, 0, -1]] * 9  # straight down


@pytest.mark.parametrize(("wall_m", "fault"), [(1.99, True), (2.0, False)])
def test_a_way_is_free_up_to_the_next_surface(wall_m: float, fault: bool) -> None:
    caster: Any = Around(np.full(256, wall_m))
    places = np.array([[0.0, 0, 0], [0, 0, 0], [0, 2, 0]])
    way = (np.array([0.0, 1, 4]), places)
    if fault:
        with pytest.raises(InputError, match="goes through a surface between 1 and 4 s"):
            check_free(caster, *way)
    else:
        check_free(caster, *way)
        assert caster.directions[-1].tolist() == [[0, 1, 0]]


def scanned(
    mesh: Mesh, origin: ArrayLike, sweep: Sweep = TURN, anywhere: bool = False
) -> ScanTable:
    model, place = open_error_model("none"), list(np.asarray(origin, dtype=float))
    job = ScanJob(mesh, load_sensor("vlp16"), sweep, model, place, anywhere)
    return job.table(np.random.default_rng(0))


def with_crate() -> Mesh:
    """The room and a crate of 1.6 m in its corner, each one object."""
    mesh = joined([replace(room(), labels=None), replace(box([0.2] * 3, [1.6] * 3), labels=None)])
    ids = np.repeat(np.array([0, 1], dtype=np.int32), 12)
    objects = (SceneObject("walls", "wall"), SceneObject("crate_1", "crate"))
    return replace(mesh, labels=Labels(ids, ids, objects, ()))


@pytest.mark.parametrize("place", [[-0.2, 2.5, 1.3], [3, 2.5, 3.01], [3, 2.5, -40]])
def test_outside_a_closed_room_is_refused_however_near(place: ArrayLike) -> None:
    with pytest.raises(InputError, match=r"is outside the scene: \d+% of all directions meet it"):
        scanned(room(), place)


def test_an_outside_that_is_meant_is_scanned() -> None:
    table = scanned(room(), [-0.2, 2.5, 1.3], anywhere=True)
    assert table["x"] == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("place", [[0.05, 0.05, 0.05], [3, 2.5, 1.3], [5.95, 4.95, 2.95]])
def test_every_corner_of_a_room_without_a_ceiling_or_a_wall_is_inside(place: ArrayLike) -> None:
    for skip in ((), ("+z",), ("+x",)):
        if np.linalg.norm(place) < 5 or not skip:
            assert len(scanned(room(skip), place)) > 0


def test_the_notch_of_an_l_shaped_building_is_outside() -> None:
    """Two closed boxes make an L; its bounding box has the notch inside."""
    plan = joined([replace(box([0, 0, 0], [6, 2, 3]), labels=None), box([0, 2, 0], [2, 4, 3])])
    plan = replace(plan, labels=None)
    assert len(scanned(plan, [1, 4, 1.3])) > 0
    with pytest.raises(InputError, match="is outside"):
        scanned(plan, [4, 4, 1.3])


def test_inside_of_a_thing_is_refused_by_its_name() -> None:
    with pytest.raises(InputError, match="is inside crate_1, the only object that it sees"):
        scanned(with_crate(), [1, 1, 1])
    assert len(scanned(with_crate(), [1, 1, 1], anywhere=True)) > 0
    assert len(scanned(with_crate(), [3, 2.5, 1.3])) > 0


def test_a_scene_of_one_object_is_no_thing_to_be_inside_of() -> None:
    ids = np.zeros(12, dtype=np.int32)
    alone = Labels(ids, ids, (SceneObject("walls", "wall"),), ())
    assert len(scanned(replace(room(), labels=alone), [1, 1, 1])) > 0


def test_a_thing_without_a_label_has_no_name_to_be_refused_by() -> None:
    scene = with_crate()
    assert scene.labels is not None
    ids = np.where(scene.labels.object_id == 1, -1, 0).astype(np.int32)
    nameless = replace(scene, labels=replace(scene.labels, object_id=ids))
    assert len(scanned(nameless, [1, 1, 1])) > 0


def test_without_labels_a_thing_is_known_by_how_near_all_is() -> None:
    niche = joined([replace(room(), labels=None), replace(box([2, 2, 1], [1, 1, 1]), labels=None)])
    with pytest.raises(InputError, match=r"is enclosed: it sees no farther than 0\.\d\d m"):
        scanned(niche, [2.5, 2.5, 1.5])
    assert len(scanned(niche, [4, 4, 1.5])) > 0


def way(*places: ArrayLike) -> Sweep:
    rows = [(0.1 * k, *map(float, place), 0, 0, 0) for k, place in enumerate(places)]
    return open_sweep({"azimuth_step_deg": 1.0, "trajectory": rows})


def test_a_way_through_a_wall_is_refused_with_its_time() -> None:
    screen = quad([3, 0, 0], [0, 5, 0], [0, 0, 2])
    halved = joined([replace(room(), labels=None), screen])
    around = way([0, 0, 0], [0, 0, 1.2], [2, 0, 1.2], [2, 0, 0])
    assert len(scanned(halved, [2, 2, 1], around)) > 0
    through = way([0, 0, 0], [0.5, 0, 0], [2, 0, 0])
    with pytest.raises(InputError, match=r"goes through a surface between 0\.1 and 0\.2 s"):
        scanned(halved, [2, 2, 1], through)
    assert len(scanned(halved, [2, 2, 1], through, anywhere=True)) > 0


def test_a_way_that_touches_is_always_refused_as_far_as_the_sweep_goes() -> None:
    touching = way([0, 0, 0], [1, 0, 0], [4, 0, 0])
    with pytest.raises(InputError, match=r"the sensor at \[6\.0, 2\.0, 1\.0\] touches the mesh"):
        scanned(room(), [2, 2, 1], touching, anywhere=True)
    assert len(scanned(room(), [2, 2, 1], touching.replaced(duration_s=0.15))) > 0


def test_a_fixed_pose_stands_at_its_place_not_at_the_origin() -> None:
    pose = open_sweep({"preset": "spin", "trajectory": [(0, 0, 0, 4.0, 0, 0, 0)]})
    with pytest.raises(InputError, match=r"the sensor at \[3\.0, 2\.0, 5\.0\] is outside"):
        scanned(room(), [3, 2, 1], pose)


def test_of_several_surfaces_in_the_way_the_first_is_told() -> None:
    screen = quad([3, 0, 0], [0, 5, 0], [0, 0, 2])
    halved = joined([replace(room(), labels=None), screen])
    there_and_back = way([0, 0, 0], [0.5, 0, 0], [2, 0, 0], [0, 0, 0], [2, 0, 0])
    with pytest.raises(InputError, match=r"goes through a surface between 0\.1 and 0\.2 s"):
        scanned(halved, [2, 2, 1], there_and_back)
