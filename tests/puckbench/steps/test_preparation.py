import numpy as np
import pytest

from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud
from pointkit.geometry.mesh import Labels, Mesh, Primitive, SceneObject
from puckbench.geometry.crop import inside_box
from puckbench.geometry.normals import estimate_normals
from puckbench.geometry.sampling import sample_surface
from puckbench.geometry.scaling import cube_scaling
from puckbench.steps.preparation import MeasuredPoints, prepare
from tests.support.processors import printed_on_processors


def _two_triangles() -> Mesh:
    """A triangle of area 0.5 at z = 0 and one of area 1.5 at z = 1."""
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [3, 0, 1], [0, 1, 1.0]])
    labels = Labels(
        np.zeros(2, np.int32),
        np.array([4, 7], np.int32),
        (SceneObject("a", "wall"),),
        tuple(Primitive("plane", {}) for _ in range(8)),
    )
    return Mesh(vertices, np.array([[0, 1, 2], [3, 4, 5]]), labels)


def test_samples_are_uniform_by_area() -> None:
    cloud = sample_surface(_two_triangles(), 40_000, np.random.default_rng(0))
    upper = cloud.xyz[:, 2] > 0.5
    assert upper.mean() == pytest.approx(0.75, abs=0.01)
    centroid = cloud.xyz[upper].mean(axis=0)
    assert centroid == pytest.approx([1, 1 / 3, 1], abs=0.02)
    assert cloud.labels is not None
    assert cloud.normals is not None
    assert np.array_equal(cloud.labels, np.where(upper, 7, 4))
    assert np.allclose(cloud.normals, [0, 0, 1])


def test_samples_lie_within_their_triangles() -> None:
    cloud = sample_surface(_two_triangles(), 1000, np.random.default_rng(0))
    low = cloud.xyz[cloud.xyz[:, 2] < 0.5]
    assert (low[:, :2] >= 0).all()
    assert (low[:, 0] + low[:, 1] <= 1 + 1e-12).all()


def test_scaling_is_pcc_arenas() -> None:
    points = np.array([[1.0, 2.0, 3.0], [3.0, 3.0, 3.5]])
    scaling = cube_scaling(points, 1024)
    scaled = scaling.apply(points)
    assert scaled.tolist() == [[0, 0, 0], [1023, 511.5, 255.75]]
    assert np.allclose(scaled / scaling.scale + scaling.offset, points, atol=1e-12)


def test_a_cloud_without_extent_cannot_be_scaled() -> None:
    with pytest.raises(InputError, match="no extent"):
        cube_scaling(np.ones((5, 3)))


def test_cropping_keeps_the_faces_of_the_box() -> None:
    box = np.array([[0.0, 0, 0], [1, 1, 1]])
    points = np.array([[0.5, 0.5, 0.5], [1, 1, 1], [1.001, 0.5, 0.5], [0.5, -0.001, 0.5]])
    assert inside_box(points, box).tolist() == [True, True, False, False]


def test_normals_of_a_sphere_are_radial() -> None:
    rng = np.random.default_rng(3)
    points = rng.normal(size=(20_000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    cosines = np.abs(np.sum(estimate_normals(points, 30) * points, axis=1))
    assert np.degrees(np.arccos(np.clip(np.median(cosines), 0, 1))) < 1


def test_a_prepared_cloud_knows_its_way_back_to_metres() -> None:
    rng = np.random.default_rng(4)
    cloud = PointCloud(rng.random((500, 3)) * [4, 2, 3] + [10, 20, 30])
    ready = prepare(cloud, 1024, 10)
    assert ready.xyz.min() == 0
    assert ready.xyz.max() == pytest.approx(1023)
    step_m = 2.0**-16 * 4 / 1023
    assert np.allclose(ready.to_metres(ready.xyz), cloud.xyz, rtol=0, atol=0.51 * step_m)
    assert ready.about["elongation"] == pytest.approx(0.5, abs=0.02)
    assert ready.normals is not None
    assert np.allclose(np.linalg.norm(ready.normals, axis=1), 1)


def test_unscaled_preparation_keeps_metres() -> None:
    points = np.random.default_rng(4).random((50, 3))
    assert np.array_equal(prepare(PointCloud(points), 0, 10).xyz, points)


def test_voxels_are_coded_on_the_whole_numbers_that_they_were() -> None:
    cells = np.random.default_rng(4).integers(0, 1024, (50, 3)).astype(float)
    step, origin = 1.8 / 1024, [0.0, -1.8, 0.3]
    grid = {"metres": step, "origin": origin, "size": 1024}
    ready = prepare(PointCloud(cells * step + origin, about={"grid": grid}), "grid", 10)
    assert np.array_equal(ready.xyz, cells)
    assert np.allclose(ready.to_metres(ready.xyz), cells * step + origin, atol=1e-12)
    assert ready.about["size"] == 1024
    between = PointCloud((cells + 0.5) * step + origin, about={"grid": grid})
    with pytest.raises(InputError, match="size grid: 50 of 50 points are not on the cloud's grid"):
        prepare(between, "grid", 10)
    with pytest.raises(InputError, match="has no grid"):
        prepare(PointCloud(cells), "grid", 10)


def test_returns_are_cropped_together_by_clean_or_noisy_coordinates() -> None:
    clean = PointCloud(np.array([[0.5, 0.5, 0.99], [0.5, 0.5, 0.5]]))
    noisy = PointCloud(np.array([[0.5, 0.5, 1.01], [0.5, 0.5, 0.5]]))
    box = np.array([[0.0, 0, 0], [1, 1, 1]])
    assert len(MeasuredPoints(noisy, clean).cropped(box, "clean").cloud) == 2
    by_noisy = MeasuredPoints(noisy, clean).cropped(box, "noisy")
    assert len(by_noisy.cloud) == len(by_noisy.clean) == 1


def test_true_points_are_scaled_like_the_measured_ones() -> None:
    rng = np.random.default_rng(6)
    clean = PointCloud(rng.random((100, 3)))
    noisy = PointCloud(clean.xyz + 0.01)
    ready = prepare(noisy, 1024, 10)
    truth = MeasuredPoints(noisy, clean).truth_in_frame_of(ready)
    assert np.allclose(ready.to_metres(truth.xyz), clean.xyz, rtol=0, atol=1e-8)


_SCALED_SCAN = """
from hashlib import sha256
import numpy as np
from pointkit.geometry.cloud import PointCloud
from pointkit.lidar.sensors import load_sensor
from puckbench.steps.preparation import prepare
from virtual_lidar import free_origin, open_error_model, open_sweep, scan
from virtual_lidar.scenes.rooms import make_room

mesh = make_room("office_1", seed=1)
sweep, model = open_sweep({"azimuth_step_deg": 1.0}), open_error_model("vlp16", None)
random = np.random.default_rng(1)
table = scan(mesh, load_sensor("vlp16"), sweep, model, free_origin(mesh), random)
ready = prepare(PointCloud(table.xyz_noisy), 1024, 10)
print(len(ready.xyz), sha256(ready.xyz.tobytes()).hexdigest())
"""


def test_the_scaled_cloud_of_a_scan_is_the_same_on_every_processor() -> None:
    assert len(printed_on_processors(_SCALED_SCAN)) == 1
