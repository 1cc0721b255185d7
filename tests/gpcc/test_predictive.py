"""Predictive geometry: streams of the reference software, and what trees are made of."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gpcc import predictive_coder, syntax
from gpcc.azimuth_order import azimuth_order
from gpcc.bits import BitReader
from gpcc.coder import decode_geometry
from gpcc.conformance import FOLDER
from gpcc.kd_tree import build, build_in_threads, empty_trees
from gpcc.prediction_tree import add_position, empty_forest, nearest, nearest_tree
from gpcc.predictive_coder import PredictiveOptions, encode_predictive_geometry
from gpcc.sensor import SensorDescription
from gpcc.spherical import Sphere, cartesian, cosine, sine, spherical
from pointkit.compiling import compiled
from pointkit.errors import InputError
from pointkit.files import read_json
from tests.support.small_turn import SENSOR, small_turn

MANIFEST: dict[str, dict[str, Any]] = read_json(FOLDER / "manifest.json")
ONE_LASER = SensorDescription((0.0,), (0.0,), 800)
BY_AZIMUTH = {"order": "azimuth", "slice_qp_interval_log2": 0}
UNSORTED = {"order": "azimuth", "azimuth_sort_precision": 0.0, "slice_qp_interval_log2": 0}


def _lossy(radius: int, azimuth: int) -> dict[str, Any]:
    steps = {"radius_inv_scale_log2": radius, "azimuth_scale_log2": azimuth}
    return {**BY_AZIMUTH, **steps, "base_qp": 58 if radius else None}


OPTIONS: dict[str, dict[str, Any]] = {
    "predictive": {"order": "morton"},
    "trees_given": {"order": "given"},
    "trees_morton": {"order": "morton"},
    "trees_azimuth": UNSORTED,
    "trees_radius": {"order": "radius"},
    "trees_short": {**BY_AZIMUTH, "tree_max_points": 300},
    "trees_qp": {**BY_AZIMUTH, "base_qp": 29},
    "trees_one": {"order": "morton"},
    "trees_two": {"order": "morton"},
    "trees_same": {"order": "morton"},
    "turn_0": _lossy(0, 12),
    "turn_1": _lossy(1, 12),
    "turn_4": _lossy(4, 9),
    "turn_8": _lossy(8, 7),
    "turn_angles": {**_lossy(0, 12), "azimuth_scaling": False},
    "turn_short": {**_lossy(0, 12), "tree_max_points": 300},
    "turn_one_laser": {"order": "morton", "azimuth_scale_log2": 5, "azimuth_speed": 363},
}


def _points(name: str) -> np.ndarray:
    """The points of a vector that loses none, in the order of its trees."""
    decoded = decode_geometry((FOLDER / f"{name}.bin").read_bytes())
    return decoded.points + decoded.origin


def _source(name: str) -> np.ndarray:
    """The points of a vector as they were given to TMC13, where trees keep their order."""
    few = name in {"predictive", "trees_one", "trees_two", "trees_same", "turn_one_laser"}
    return _points(name) if few else small_turn().astype(np.int64)


@pytest.mark.parametrize("name", OPTIONS)
def test_encoding_gives_the_bytes_of_tmc13(name: str) -> None:
    kept = "--mergeDuplicatedPoints=0" in MANIFEST[name]["options"]
    options = PredictiveOptions(**OPTIONS[name], merge_duplicates=not kept)
    sensor = {"turn": SENSOR, "turn_one_laser": ONE_LASER}.get(
        name if name == "turn_one_laser" else name.partition("_")[0]
    )
    stream = encode_predictive_geometry(_source(name), options, sensor=sensor)
    assert stream == (FOLDER / f"{name}.bin").read_bytes()


def test_trees_that_the_reference_reads_otherwise_than_it_writes_come_back() -> None:
    """Here TMC13's own options have a QP for each slice, or it cuts slices where we do not."""
    points = _points("turn_0")
    for changes in ({"slice_max_points": 500}, {"base_qp": 0, "qp_multiplier_log2": 2}):
        stream = encode_predictive_geometry(points, PredictiveOptions(**changes), sensor=SENSOR)
        decoded = decode_geometry(stream)
        assert _sorted(decoded.positions()) == _sorted(points)


def _sorted(points: np.ndarray) -> list[list[float]]:
    return sorted(points.tolist())


CUBE = np.random.default_rng(1).integers(-9, 10, (400, 3))


@pytest.mark.parametrize("sensor", [None, SENSOR, ONE_LASER])
@pytest.mark.parametrize("order", ["given", "morton", "azimuth", "radius"])
@pytest.mark.parametrize(
    "points",
    [CUBE, CUBE[:1], np.repeat(CUBE[:5], 9, axis=0), CUBE * [1, 0, 0], CUBE * 100_000],
    ids=["cube", "one", "repeated", "line", "wide"],
)
def test_points_come_back(points: np.ndarray, order: Any, sensor: Any) -> None:
    stream = encode_predictive_geometry(
        points, PredictiveOptions(order=order), sensor=sensor, origin=(5, -6, 7)
    )
    decoded = decode_geometry(stream)
    assert _sorted(decoded.positions()) == _sorted(points + np.array([5, -6, 7]))


def test_equal_points_can_be_merged() -> None:
    points = np.repeat(CUBE, 3, axis=0)
    stream = encode_predictive_geometry(
        points, PredictiveOptions(merge_duplicates=True), sensor=SENSOR
    )
    assert len(decode_geometry(stream).points) == len(np.unique(CUBE, axis=0))


def test_a_sensor_saves_a_third_of_the_bits() -> None:
    points = _points("turn_0")
    plain, angular = (
        len(encode_predictive_geometry(points, sensor=sensor)) for sensor in (None, SENSOR)
    )
    assert angular < 0.67 * plain


def test_coarser_steps_of_radius_and_azimuth_stay_near() -> None:
    points = _points("turn_0")
    sizes, worst = [], []
    for radius, azimuth in ((1, 12), (4, 9), (8, 7)):
        stream = encode_predictive_geometry(
            points, PredictiveOptions(**_lossy(radius, azimuth)), sensor=SENSOR
        )
        decoded = decode_geometry(stream).positions()
        off = np.abs(decoded[:, None] - points[None]).max(axis=2).min(axis=1)
        sizes.append(len(stream))
        worst.append(off.max())
    assert sizes == sorted(sizes, reverse=True)
    assert max(worst) <= 160 / 2 + 1  # half the step of QP 58


@compiled
def _nearest_by_turns(points: np.ndarray, search: Any, found: np.ndarray) -> None:
    for i in range(len(points)):
        for k in range(nearest(search, points[i, 0], points[i, 1], points[i, 2])):
            found[i, k] = search.trees.distances[k]
        add_position(search, i, points[i, 0], points[i, 1], points[i, 2])


@pytest.mark.parametrize("spread", [3, 30, 3000])
def test_the_three_nearest_of_a_growing_set_are_found(spread: int) -> None:
    points = np.random.default_rng(2).integers(-spread, spread, (700, 3))
    result = np.full((len(points), 3), -1)
    _nearest_by_turns(points, empty_forest(len(points)), result)
    squared = ((points[:, None] - points[None]) ** 2).sum(axis=2)
    for i in range(3, len(points)):
        assert result[i].tolist() == np.sort(squared[i, :i])[:3].tolist()


def test_parents_come_before_their_children_and_have_three_at_most() -> None:
    points = CUBE.astype(np.int32)
    tree = nearest_tree(points, len(points))
    rows = np.flatnonzero(tree.parents >= 0)
    assert (tree.parents[rows] < rows).all()
    assert np.bincount(tree.parents[rows]).max() <= 3
    assert (tree.parents == -1).sum() + len(rows) + tree.copies.sum() == len(points)


def test_a_tree_built_in_threads_is_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    points = np.random.default_rng(5).integers(0, 60, (20_000, 3))  # many are equally near
    order = []
    for builder, threads in ((build, "1"), (build_in_threads, "1"), (build_in_threads, "3")):
        monkeypatch.setenv("OMP_NUM_THREADS", threads)
        trees = empty_trees(np.int32, len(points), 1)
        trees.places[:], trees.rows[:] = points.T, np.arange(len(points))
        builder(trees, 0, len(points), np.empty(6, dtype=np.int64), 1.0)
        assert (points[trees.rows] == trees.places.T).all()
        order.append(trees.rows.tolist())
    assert order[0] == order[1] == order[2]


def test_large_trees_give_the_same_parents_in_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    points = np.random.default_rng(5).integers(0, 60, (14_000, 3)).astype(np.int32)
    parents = []
    for threads in ("1", "3"):
        monkeypatch.setenv("OMP_NUM_THREADS", threads)
        parents.append(nearest_tree(points, len(points)).parents.tolist())
    assert parents[0] == parents[1]


def test_the_azimuths_order_is_by_angle_then_radius_then_slope() -> None:
    around = np.random.default_rng(3).integers(-60, 60, (5000, 3))
    rows = azimuth_order(around, 8.0)
    x, y, z = around.T
    radius = np.hypot(x, y)
    with np.errstate(invalid="ignore", divide="ignore"):
        keys = np.stack([np.round(np.arctan2(y, x) * 8), radius, z / radius], axis=1)
    same = np.lexsort(keys.T[::-1])
    assert np.array_equal(keys[rows], keys[same], equal_nan=True)


@compiled
def _sines(angles: np.ndarray, log2: int, found: np.ndarray) -> None:
    for i in range(len(angles)):
        found[i, 0] = sine(angles[i], log2)
        found[i, 1] = cosine(angles[i], log2)


@pytest.mark.parametrize("log2", [12, 19, 24, 30])
def test_sines_are_those_of_the_angle(log2: int) -> None:
    half = 1 << (log2 - 1)
    angles = np.linspace(-half, half, 5001).astype(np.int64)
    result = np.empty((len(angles), 2), dtype=np.int64)
    _sines(angles, log2, result)
    exact = angles * (np.pi / half)
    expected = np.stack([np.sin(exact), np.cos(exact)], axis=1) * 2**24
    assert np.abs(result - expected).max() < 8


@compiled
def _there_and_back(points: np.ndarray, around: Any, found: np.ndarray) -> None:
    for i in range(len(points)):
        r, azimuth, laser = spherical(around, points[i, 0], points[i, 1], points[i, 2])
        found[i, 0], found[i, 1], found[i, 2] = cartesian(around, r, azimuth, laser)


def test_spherical_coordinates_lead_back_to_the_point() -> None:
    lasers = SENSOR.lasers()
    theta, z = np.array([(laser.theta, laser.z) for laser in lasers]).T
    points = _points("turn_0")
    result = np.empty_like(points)
    _there_and_back(points, Sphere(0, 24, theta, z, (0, 0, 0)), result)
    assert np.abs(result - points)[:, :2].max() <= 1
    assert np.abs(result - points)[:, 2].max() <= 3  # of a laser's plane


@pytest.mark.parametrize(
    ("points", "sensor", "said"),
    [
        (np.empty((0, 3), int), None, "no points"),
        (np.array([[0, 0, 0], [1 << 21, 0, 0]]), None, "21 bits apart"),
        (CUBE, SensorDescription((0.0,), (0.0,), 9, (1 << 23, 0, 0)), "bits away"),
    ],
)
def test_what_cannot_be_coded_is_refused(points: np.ndarray, sensor: Any, said: str) -> None:
    with pytest.raises(InputError, match=said):
        encode_predictive_geometry(points, PredictiveOptions(), sensor=sensor)


def test_residuals_wider_than_expected_are_given_more_bits(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(predictive_coder, "_residual_bits", lambda *_: (1, 0, 0))
    stream = encode_predictive_geometry(CUBE, PredictiveOptions(), sensor=SENSOR)
    assert _sorted(decode_geometry(stream).positions()) == _sorted(CUBE)


def test_many_small_slices_take_little_time_each() -> None:
    stream = encode_predictive_geometry(CUBE[:1], PredictiveOptions(), sensor=SENSOR)
    units = [syntax.encapsulate(*unit) for unit in syntax.payloads(stream)]
    assert len(decode_geometry(b"".join(units[:-1]) + units[-1] * 1000).points) == 1000
    with pytest.raises(InputError, match="more than 16384 octree levels"):
        decode_geometry(b"".join(units[:-1]) + units[-1] * 9000)


@pytest.mark.parametrize(
    ("field", "value", "said"),
    [
        ("geom_base_qp", 224, "header of a slice"),
        ("geom_angular_azimuth_scale_log2_minus11", 19, "steps of the azimuth"),
        ("geom_angular_radius_inv_scale_log2", 31, "steps of the azimuth or the radius"),
    ],
)
def test_fields_beyond_what_can_be_computed_are_refused(field: str, value: int, said: str) -> None:
    stream = encode_predictive_geometry(CUBE, PredictiveOptions(base_qp=8), sensor=SENSOR)
    units = dict(syntax.payloads(stream))
    gps = syntax.GeometryParameterSet()
    syntax.geometry_parameter_set(BitReader(units[1]), gps)
    units[1] = syntax.written(syntax.geometry_parameter_set, replace(gps, **{field: value}))
    with pytest.raises(InputError, match=said):
        decode_geometry(b"".join(syntax.encapsulate(*unit) for unit in units.items()))
