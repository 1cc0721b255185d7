"""Rates of the primitives codec: bits grow in steps below 3, and distances fall."""

from collections.abc import Iterable
from functools import cache

import numpy as np
import pytest

from pointkit.geometry.cloud import PointCloud
from pointkit.lidar.sensors import load_sensor
from primitive_codec.mode_decision import _best_surface, _evaluate, frame_candidates
from primitive_codec.preparation import prepare
from primitive_codec.settings import PrimitiveSettings
from puckbench.codecs.registry import open_codec
from puckbench.metrics.geometry import distortion
from puckbench.scene_sets.embedded_rooms import EmbeddedRooms
from puckbench.steps.preparation import MeasuredPoints
from puckbench.steps.preparation import prepare as prepare_cloud
from tests.support.codecs import decode, encode
from tests.support.default_clouds import CLOUDS, sampled_room
from virtual_lidar import free_origin, open_error_model, open_sweep, scan

_BOXES = (
    ((0, 0, 0), (1023, 700, 500)),
    ((300, 250, 0), (520, 370, 140)),
    ((700, 60, 0), (960, 190, 330)),
    ((60, 480, 0), (150, 660, 210)),
    ((620, 430, 120), (800, 560, 140)),
    ((430, 20, 200), (470, 60, 420)),
)
_POINTS = 48_000


def _furnished(noise: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A room and boxes in it: true points on them, their normals, and the points with noise."""
    rng = np.random.default_rng(4)
    low, high = np.repeat(np.array(_BOXES, float), 6, axis=0).transpose(1, 0, 2).copy()
    rows, side = np.arange(len(low)), np.arange(len(low)) % 6
    upper = side % 2 == 1
    low[rows[upper], side[upper] // 2] = high[rows[upper], side[upper] // 2]
    high[rows[~upper], side[~upper] // 2] = low[rows[~upper], side[~upper] // 2]
    sizes = high - low
    sizes[rows, side // 2] = 1.0
    areas = sizes.prod(axis=1)
    which = rng.choice(len(low), _POINTS, p=areas / areas.sum())
    true = low[which] + rng.random((_POINTS, 3)) * (high - low)[which]
    normals = np.eye(3)[side[which] // 2]
    return true, normals, true + rng.normal(0, noise, (_POINTS, 1)) * normals


def _curve(
    reference: PointCloud, truth: PointCloud | None = None, rates: Iterable[str] = ()
) -> np.ndarray:
    """Bytes, D1, distances to the points (to plane, to point) and the truth, share of points."""
    codec, rows = open_codec("primitives"), []
    shared = codec.prepare(reference)
    for rate in rates or codec.rates:
        stream = encode(codec, reference.xyz, rate, shared)
        decoded = decode(codec, stream)
        to_points = distortion(reference, decoded)
        to_truth = distortion(truth, decoded)["cd_plane"] if truth else 0.0
        measured = [to_points[key] for key in ("d1_mse", "cd_plane", "cd_point")]
        rows.append([len(stream), *measured, to_truth, len(decoded) / len(reference)])
    return np.array(rows)


@cache
def _curve_of(name: str) -> np.ndarray:
    return _curve(CLOUDS[name]())


@pytest.mark.parametrize("name", ["airplane_01", "chair_01", "office_1, raw"])
def test_bits_grow_in_steps_below_3_and_distances_fall(name: str) -> None:
    curve = _curve_of(name)[:, :3]
    steps = curve[1:] / curve[:-1]
    assert steps[:, 0].min() > 1
    assert steps[:, 0].max() < 3
    # Decoded points of a finer rate may lie further between the points that were coded; how far
    # depends on the points' last digits.
    assert (steps[:, 1] < 1.25).all()
    assert (steps[:, 2] < 1).all()


def test_decoded_rooms_have_as_many_points_as_were_coded() -> None:
    """Rates with a surface, within 5 %; r8 codes voxels, each of which is a point."""
    assert _curve_of("office_1, raw")[:7, 5] == pytest.approx(1, rel=0.05)


@pytest.mark.parametrize(
    ("points", "rates"), [(40_000, ("r4", "r5")), (120_000, ("r4", "r5", "r6"))]
)
def test_where_surfaces_alone_lose_voxels_stand_beside_one(
    points: int, rates: tuple[str, ...]
) -> None:
    curve = _curve(sampled_room("storage_1", points), rates=rates)[:, :4]
    steps = curve[1:] / curve[:-1]
    assert (steps[:, 0] > 1).all()
    assert (steps[:, 1] < 1.01).all()
    assert (steps[:, 2:] < 1).all()


@pytest.mark.parametrize(
    ("noise", "rates"),
    [(0.0, ("r2", "r4", "r6", "r7")), (2.5, ("r2", "r5", "r6", "r7"))],
)
def test_more_bits_bring_a_room_nearer_until_noise_is_coded(
    noise: float, rates: tuple[str, ...]
) -> None:
    true, normals, points = _furnished(noise)
    curve = _curve(PointCloud(points, normals), PointCloud(true, normals), rates)
    steps = curve[1:] / curve[:-1]
    assert (steps[:, 0] > 1).all()
    assert (steps[:, 1:4] < 1).all()
    # From r6 on noise is coded: the truth is left step by step, not in one leap.
    assert (steps[:, 4] < (3 if noise else 1)).all()


def test_the_truth_of_a_cluttered_room_is_left_no_sooner_than_at_the_highest_rate() -> None:
    mesh = EmbeddedRooms().load("storage_1").mesh
    assert mesh is not None
    sweep, model = open_sweep({"azimuth_step_deg": 1.8}), open_error_model("vlp16_divergence")
    sensor, rng = load_sensor("vlp16"), np.random.default_rng(0)
    table = scan(mesh, sensor, sweep, model, free_origin(mesh), rng)
    returns = MeasuredPoints(PointCloud(table.xyz_noisy), PointCloud(table.xyz, table.normals))
    cloud = prepare_cloud(returns.cloud)
    curve = _curve(cloud, returns.truth_in_frame_of(cloud), ("r6", "r7", "r8"))
    steps = curve[1:] / curve[:-1]
    assert (steps[:, 1:4] < 1).all()
    assert (steps[:, 4] > 1).all()
    assert (steps[:, 4] < 1.8).all()


def test_mode_decision_improves_a_badly_aligned_grid() -> None:
    _, _, points = _furnished(0.0)
    cloud = prepare(
        points, PrimitiveSettings(min_leaf_size=32, column_size=16, lmbda=600, plane_step=8)
    )
    trials = [_evaluate(cloud, mode).cost for mode in frame_candidates(cloud)]
    assert _best_surface(cloud).cost < 0.95 * min(trials)
