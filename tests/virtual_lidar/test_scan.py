from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from pointkit.geometry.mesh import Mesh
from pointkit.lidar.sensor import Sensor
from pointkit.lidar.sensors import load_sensor
from tests.support.sensor_scenes import ROOM, box, joined, moved, quad, room, wall
from virtual_lidar import COLUMNS, ScanJob, ScanTable, Sweep, error_model_names, open_error_model
from virtual_lidar.errors.model import Draws, ErrorModel, Hits
from virtual_lidar.raycast import RayCaster
from virtual_lidar.sweep import SWEEPS, Rays

VLP16 = load_sensor("vlp16")
SMALL = Sweep(duration_s=0.5, azimuth_step_deg=1.0)
CENTRE = np.array([3.1, 2.4, 1.3])


def scanned(
    mesh: Mesh,
    errors: str = "none",
    origin: ArrayLike = CENTRE,
    sweep: Sweep = SMALL,
    sensor: Sensor = VLP16,
    seed: int = 1,
    **settings: Any,
) -> ScanTable:
    options = settings.pop("options", {})
    model = open_error_model(errors, options)
    job = ScanJob(mesh, sensor, sweep, model, origin, threads=settings.pop("threads", 0))
    return job.table(np.random.default_rng(seed), **settings)


def nominal_directions(table: ScanTable, sweep: Sweep) -> Floats:
    """World directions worked out again from the reported angles, by spherical trigonometry."""
    tilt = sweep.pitch_rad()[table["frame"]]
    yaw, pitch = table["yaw"], table["pitch"]
    forward = np.cos(pitch) * np.cos(yaw)
    return np.column_stack(
        [
            -np.cos(pitch) * np.sin(yaw),
            forward * np.cos(tilt) - np.sin(pitch) * np.sin(tilt),
            forward * np.sin(tilt) + np.sin(pitch) * np.cos(tilt),
        ]
    )


def test_a_caster_knows_the_plane_of_every_triangle_from_where_it_stands() -> None:
    mesh = room()
    planes = RayCaster(mesh, CENTRE).planes
    assert planes.shape == (12, 4)
    assert np.abs(planes[:, :3]).tolist() == np.repeat(np.eye(3), 4, axis=0).tolist()
    corners = mesh.vertices[mesh.triangles] - CENTRE
    heights = np.einsum("tcx,tx->tc", corners, planes[:, :3])
    assert heights == pytest.approx(np.repeat(planes[:, 3:], 3, axis=1))


def test_rays_are_cast_along_unit_vectors_to_the_walls() -> None:
    sweep, caster = Sweep(duration_s=0.05, azimuth_step_deg=1.0), RayCaster(room(), CENTRE)
    frames = range(sweep.frames)
    rays, poses = sweep.rays(VLP16, frames), sweep.poses(VLP16, frames)
    cast = caster.cast(rays, poses, (0.0, 100.0))
    assert cast.directions.shape == (rays.yaw.size, 3)
    assert np.linalg.norm(cast.directions, axis=1) == pytest.approx(1)
    points = CENTRE + cast.hits.distance.reshape(-1, 1) * cast.directions
    apart = np.minimum(np.abs(points), np.abs(ROOM - points)).min(axis=1)
    assert apart == pytest.approx(0, abs=1e-9)


def test_every_ray_of_a_sweep_in_a_closed_room_returns() -> None:
    table = scanned(room())
    assert len(table) == 60 * 15 * 16
    assert np.array_equal(table["laser_id"], np.tile(np.arange(16), 900))
    assert np.array_equal(table["frame"], np.repeat(np.arange(60), 240))
    assert (np.diff(table["timestamp"][::16]) > 0).all()


def test_lasers_have_their_elevations() -> None:
    table = scanned(room())
    assert np.degrees(table["pitch"][:16]) == pytest.approx(VLP16.laser_elevation_deg)


@pytest.mark.parametrize("distance", [1.0, 5.0, 50.0])
def test_a_walls_distance_and_incidence_have_their_closed_form(distance: float) -> None:
    table = scanned(wall(distance), origin=np.zeros(3))
    towards = nominal_directions(table, SMALL)[:, 1]
    assert table["distance"] == pytest.approx(distance / towards, abs=1e-9, rel=0)
    assert table["y"] == pytest.approx(distance, abs=1e-9, rel=0)
    assert np.cos(table["incidence"]) == pytest.approx(towards, abs=1e-12)
    assert np.array_equal(table.normals, np.tile([0.0, -1.0, 0.0], (len(table), 1)))
    assert table["distance"].max() > 0.9 * 100


def test_points_lie_along_the_nominal_ray_at_their_distance() -> None:
    table = scanned(room())
    expected = CENTRE + table["distance"][:, None] * nominal_directions(table, SMALL)
    assert table.xyz == pytest.approx(expected, abs=1e-12)


def test_the_sensor_turns_counter_clockwise_from_forward() -> None:
    level = Sweep(duration_s=0.2, pitch_start_deg=0, pitch_end_deg=0, azimuth_step_deg=1)
    table = scanned(room(), sweep=level)
    first_turn = table.select((table["laser_id"] == 1) & (table["frame"] < 24))
    sides = {degrees: first_turn.xyz[degrees] - CENTRE for degrees in (0, 90, 180, 270)}
    assert sides[0][0] == pytest.approx(0)
    assert sides[0][1] > 0
    assert sides[90][0] < 0
    assert sides[180][1] < 0
    assert sides[270][0] > 0
    assert (first_turn["z"] > CENTRE[2]).all()


def test_hits_carry_triangle_object_primitive_and_normal() -> None:
    table = scanned(room())
    on_face = np.column_stack([table.xyz, ROOM - table.xyz]).argmin(axis=1)
    face = np.array([0, 2, 4, 1, 3, 5])[on_face]
    inner = np.sort(np.column_stack([table.xyz, ROOM - table.xyz]), axis=1)[:, 1] > 1e-6
    assert np.array_equal(table.object_id[inner], face[inner])
    assert np.array_equal(table.primitive_id[inner], face[inner] + 10)
    assert np.array_equal(table["triangle_id"][inner] // 2, face[inner])
    inwards = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
    assert np.array_equal(table.normals[inner], inwards[face[inner]])


def test_a_mesh_without_labels_gives_minus_one() -> None:
    table = scanned(replace(room(), labels=None))
    assert (table.object_id == -1).all()
    assert (table.primitive_id == -1).all()


def nearest_by_brute_force(mesh: Mesh, directions: Floats) -> Floats:
    """Distance from the origin to the nearest triangle in float64 (Moeller and Trumbore), (n,)."""
    first, second, third = mesh.corners().swapaxes(0, 1)
    item, two = second - first, third - first
    across = np.cross(directions[:, None], two)
    determinant = np.einsum("tj,ntj->nt", item, across)
    u = -np.einsum("tj,ntj->nt", first, across) / determinant
    over = np.cross(-first, item)
    v = directions @ over.T / determinant
    distance = np.einsum("tj,tj->t", two, over) / determinant
    struck = (u >= 0) & (v >= 0) & (u + v <= 1) & (distance > 0)
    return np.where(struck, distance, np.inf).min(axis=1)


def test_distances_in_a_heap_of_triangles_equal_those_by_brute_force() -> None:
    rng = np.random.default_rng(5)
    middles = rng.uniform(-8, 8, (400, 1, 3))
    corners = (middles + rng.normal(0, 1.0, (400, 3, 3))).reshape(-1, 3)
    heap = Mesh(corners, np.arange(1200).reshape(-1, 3))
    sweep = Sweep(duration_s=0.5, azimuth_step_deg=5.0)
    table = scanned(heap, origin=np.zeros(3), sweep=sweep)
    expected = nearest_by_brute_force(heap, nominal_directions(table, sweep))
    assert len(table) > 2000
    assert table["distance"] == pytest.approx(expected, abs=1e-9, rel=0)


def test_no_errors_means_equal_values() -> None:
    table = scanned(room())
    for name in ("distance", "x", "y", "z"):
        assert np.array_equal(table[name], table[f"{name}_noisy"])


def test_truth_is_exact_far_from_the_worlds_origin() -> None:
    far = np.array([1e5, -1e5, 5e4])
    near, away = scanned(room()), scanned(moved(room(), far), origin=CENTRE + far)
    assert away["distance"] == pytest.approx(near["distance"], abs=1e-9, rel=0)
    assert away.xyz - far == pytest.approx(near.xyz, abs=1e-9, rel=0)


def test_only_hits_in_range_return() -> None:
    lasers = VLP16.replaced(min_range_m=2.0, max_range_m=3.0)
    table = scanned(room(), sensor=lasers)
    everything = scanned(room())
    inside = (everything["distance"] >= 2) & (everything["distance"] <= 3)
    assert np.array_equal(table["distance"], everything["distance"][inside])
    assert np.array_equal(table["yaw"], everything["yaw"][inside])
    nearer = scanned(room(), sweep=SMALL.replaced(max_range_m=2.0))
    assert nearer["distance"].max() <= 2


def test_vlp16_noise_is_bias_and_ray_noise_along_the_ray() -> None:
    table = scanned(room(), "vlp16", sweep=Sweep(azimuth_step_deg=1.0))
    residual = table["distance_noisy"] - table["distance"]
    assert residual.std() == pytest.approx(np.hypot(0.014, 0.010), rel=0.03)
    assert residual.mean() == pytest.approx(0, abs=5 * 0.014 / np.sqrt(480 * 16))
    along = (table.xyz_noisy - table.xyz) / residual[:, None]
    assert along == pytest.approx(nominal_directions(table, Sweep(azimuth_step_deg=1)), abs=1e-6)


def test_plane_residuals_at_normal_incidence_have_the_models_sigma() -> None:
    """A wall straight ahead of a level sensor: residuals normal to it are the range noise."""
    level = Sweep(pitch_start_deg=0, pitch_end_deg=0, azimuth_step_deg=1.0)
    table = scanned(wall(5.0), "vlp16", origin=np.zeros(3), sweep=level)
    ahead = table["incidence"] < np.radians(20)
    assert (table["y_noisy"] - 5)[ahead].std() == pytest.approx(np.hypot(0.014, 0.010), rel=0.06)


def biases(table: ScanTable) -> Floats:
    """Noise of a scan without ray noise, (frames, steps, lasers)."""
    return (table["distance_noisy"] - table["distance"]).reshape(60, 15, 16)


def test_bias_is_constant_within_a_frame_and_laser_and_redrawn_for_the_next() -> None:
    result = biases(scanned(room(), "vlp16", options={"ray_sigma_m": 0}))
    assert np.ptp(result, axis=1).max() < 1e-14
    assert np.unique(result[:, 0].round(12)).size == 60 * 16
    assert result[:, 0].std() == pytest.approx(0.014, rel=0.1)


def test_bias_can_be_kept_for_the_whole_scan() -> None:
    options = {"ray_sigma_m": 0, "bias_redrawn": "scan"}
    result = biases(scanned(room(), "vlp16", options=options))
    assert np.ptp(result, axis=(0, 1)).max() < 1e-14
    assert np.unique(result[0, 0].round(12)).size == 16


def test_what_a_ray_meets_changes_no_other_rays_noise() -> None:
    closed, open_top = scanned(room(), "vlp16"), scanned(room(skip=("+z",)), "vlp16")
    assert len(open_top) < len(closed)
    residual = dict(
        zip(
            zip(closed["timestamp"], closed["laser_id"], strict=True),
            closed["distance_noisy"] - closed["distance"],
            strict=True,
        )
    )
    keys = zip(open_top["timestamp"], open_top["laser_id"], strict=True)
    expected = [residual[key] for key in keys]
    assert open_top["distance_noisy"] - open_top["distance"] == pytest.approx(expected, abs=1e-12)


NO_NOISE = {"bias_sigma_m": 0, "ray_sigma_m": 0}


def angles_between(table: ScanTable) -> Floats:
    """Yaw and pitch of each noisy point off the reported ones, for a level sensor, deg, (n, 2)."""
    x, y, z = (table.xyz_noisy - CENTRE).T
    yaw = np.arctan2(-x, y) - table["yaw"]
    pitch = np.arctan2(z, np.hypot(x, y)) - table["pitch"]
    return np.degrees(np.column_stack([np.angle(np.exp(1j * yaw)), pitch]))


def test_divergence_turns_rays_uniformly_within_the_beam() -> None:
    level = SMALL.replaced(pitch_start_deg=0.0, pitch_end_deg=0.0)
    table = scanned(room(), "vlp16_divergence", sweep=level, options=NO_NOISE)
    angles = angles_between(table)
    assert np.abs(angles).max(axis=0) == pytest.approx([0.09, 0.045], rel=1e-3)
    assert angles.std(axis=0) == pytest.approx(np.array([0.18, 0.09]) / np.sqrt(12), rel=0.02)
    assert np.corrcoef(angles.T)[0, 1] == pytest.approx(0, abs=0.05)


def test_divergence_keeps_the_truth_of_the_nominal_rays() -> None:
    table, truth = scanned(room(), "vlp16_divergence"), scanned(room())
    for name in COLUMNS:
        if not name.endswith("_noisy"):
            assert np.array_equal(table[name], truth[name])


def distance_from_room(points: Floats) -> Floats:
    return np.abs(np.column_stack([points, ROOM - points])).min(axis=1)


def test_divergence_as_blensor_has_it_stays_on_the_surface() -> None:
    table = scanned(room(), "vlp16_divergence", options=NO_NOISE)
    assert distance_from_room(table.xyz_noisy).max() < 1e-12
    assert np.abs(table.xyz_noisy - table.xyz).max() > 1e-3


def test_divergence_placed_on_the_nominal_ray_leaves_the_surface() -> None:
    options = {**NO_NOISE, "returns_along": "nominal"}
    table = scanned(room(), "vlp16_divergence", options=options)
    expected = CENTRE + table["distance_noisy"][:, None] * nominal_directions(table, SMALL)
    assert table.xyz_noisy == pytest.approx(expected, abs=1e-12)
    assert distance_from_room(table.xyz_noisy).max() > 1e-4


def test_a_row_needs_both_the_fired_and_the_nominal_ray_to_hit() -> None:
    plate = quad([-0.4, 3, -0.4], [0.8, 0, 0], [0, 0, 0.8])
    level = Sweep(duration_s=2, pitch_start_deg=0, pitch_end_deg=0, azimuth_step_deg=0.05)
    options = {"yaw_width_deg": 1, "pitch_width_deg": 1}
    table = scanned(plate, "vlp16_divergence", np.zeros(3), level, options=options)
    truth = scanned(plate, origin=np.zeros(3), sweep=level)
    assert 0.5 * len(truth) < len(table) < len(truth)
    assert all(np.isfinite(table[name]).all() for name in COLUMNS)
    assert np.abs(table.xyz[:, [0, 2]]).max() < 0.4 + 1e-6


@pytest.mark.parametrize(
    "errors", sorted(set(error_model_names()) - {"calibrated", "distance_table"})
)
def test_threads_and_portions_change_no_byte(errors: str) -> None:
    whole = scanned(room(skip=("+z",)), errors, rays_at_a_time=10**9, threads=1)
    for settings in ({"rays_at_a_time": 1}, {"rays_at_a_time": 2400, "threads": 2}):
        other = scanned(room(skip=("+z",)), errors, **settings)
        assert all(np.array_equal(whole[name], other[name]) for name in COLUMNS)


def test_another_seed_gives_other_noise_and_the_same_truth() -> None:
    item, two = scanned(room(), "vlp16"), scanned(room(), "vlp16", seed=2)
    assert np.array_equal(item.xyz, two.xyz)
    assert not np.array_equal(item["distance_noisy"], two["distance_noisy"])


def test_progress_is_told_to_the_end() -> None:
    output = []
    scanned(room(), progress=lambda done, of: output.append((done, of)), rays_at_a_time=2400)
    assert output == [(10 * n, 60) for n in range(1, 7)]


def test_the_table_says_how_it_was_made() -> None:
    about = scanned(room(), "thesis_room").about
    assert about["sensor"]["name"] == "VLP-16"
    assert about["sweep"]["duration_s"] == 0.5
    assert about["errors"] == {
        "model": "Vlp16",
        "bias_sigma_m": 0.014,
        "ray_sigma_m": 0.02,
        "bias_redrawn": "frame",
        "bias_distribution": "gaussian",
        "ray_distribution": "gaussian",
        "ray_mean_m": 0.0,
    }
    assert about["origin"] == CENTRE.tolist()


def test_wrong_scenes_and_places_are_named_in_one_line() -> None:
    with pytest.raises(InputError, match="has no faces"):
        scanned(Mesh(np.zeros((3, 3)), np.empty((0, 3), dtype=np.int64)))
    with pytest.raises(InputError, match=r"origin is .*, but must be three finite numbers"):
        scanned(room(), origin=[0.0, np.nan, 1.0])
    with pytest.raises(InputError, match=r"the sensor at \[0\.0, 2\.0, 1\.0\] touches the mesh"):
        scanned(room(), origin=[0.0, 2.0, 1.0])
    with pytest.raises(InputError, match="no ray returned"):
        scanned(room(), origin=[1000.0, 0.0, 0.0])


def test_a_thing_in_the_way_hides_what_is_behind() -> None:
    crate = moved(replace(box([0, 0, 0], [0.5, 0.5, 0.5]), labels=None), [4.0, 3.0, 1.0])
    table = scanned(joined([replace(room(), labels=None), crate]))
    on_crate = table["triangle_id"] >= 12
    assert on_crate.any()
    inside = ((table.xyz > [4, 3, 1]) & (table.xyz < [4.5, 3.5, 1.5])).all(axis=1)
    assert not inside.any()
    assert (table["distance"][on_crate] < scanned(room())["distance"][on_crate]).all()


def test_presets_of_sweeps_are_complete() -> None:
    assert {"thesis", "thesis_room"} <= set(SWEEPS)


@pytest.mark.parametrize("errors", ["surface_normal", "vlp16"])
def test_measured_points_are_at_their_distance_from_the_sensor(errors: str) -> None:
    table = scanned(room(), errors)
    reach = np.linalg.norm(table.xyz_noisy - CENTRE, axis=1)
    assert reach == pytest.approx(table["distance_noisy"], abs=1e-9)


def test_a_job_knows_how_many_rays_it_fires() -> None:
    job = ScanJob(room(), VLP16, SMALL, open_error_model("none"), CENTRE)
    assert job.rays == 60 * 15 * 16


@pytest.mark.parametrize("rays", [1, 1000, 10**6])
def test_a_scan_in_portions_has_the_same_rows(rays: int) -> None:
    """At least a frame at a time, whatever the bound."""
    job = ScanJob(room(), VLP16, Sweep(duration_s=0.05), open_error_model("vlp16"), CENTRE)
    parts = list(job.portions(np.random.default_rng(1), rays_in_a_portion=rays))
    whole = job.table(np.random.default_rng(1))
    assert len(parts) == {1: 6, 1000: 6, 10**6: 1}[rays]
    joined_rows = np.concatenate([part["distance_noisy"] for part in parts])
    assert joined_rows.tolist() == whole["distance_noisy"].tolist()


class _OneRay(ErrorModel):
    """Returns the values of a single ray."""

    method: str

    def perturb_rays(self, rays: Rays, sensor: Sensor, draws: Draws) -> Rays:
        narrow = replace(rays, yaw=rays.yaw[..., :1])
        return narrow if self.method == "perturb_rays" else rays

    def perturb_ranges(self, hits: Hits, sensor: Sensor, draws: Draws) -> Floats:
        distance = hits.distance
        return distance[:1, :1, :1] if self.method == "perturb_ranges" else distance

    def lift_points(self, hits: Hits, sensor: Sensor, draws: Draws) -> Floats | None:
        return np.zeros(1) if self.method == "lift_points" else None


@pytest.mark.parametrize("method", ["perturb_rays", "perturb_ranges", "lift_points"])
def test_values_of_another_shape_than_the_rays_are_refused(method: str) -> None:
    job = ScanJob(room(), VLP16, SMALL, _OneRay(method=method), CENTRE)
    with pytest.raises(InputError, match="the error model returned"):
        job.table(np.random.default_rng(0))
