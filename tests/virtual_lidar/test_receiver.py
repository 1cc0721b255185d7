from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from pointkit.geometry.mesh import SceneObject
from pointkit.lidar.sensors import load_sensor
from virtual_lidar import error_model_names, open_error_model
from virtual_lidar.errors import Draws, Hits
from virtual_lidar.errors.model import Surfaces

VLP16 = load_sensor("vlp16")
LABELS = Surfaces(
    np.array([0, 1, 2, -1], dtype=np.int32),
    (SceneObject("wall_1", "wall"), SceneObject("sofa_1", "sofa"), SceneObject("sofa_2", "sofa")),
)


def hits(
    distance: ArrayLike, incidence: float = 0.0, triangle: int = 0, labels: Surfaces | None = LABELS
) -> Hits:
    """Hits of 100 columns of 16 lasers in one frame for each of the distances."""
    spread = np.broadcast_to(np.atleast_1d(distance)[:, None, None], (np.size(distance), 100, 16))
    struck = np.full(spread.shape, triangle, dtype=np.uint32)
    return Hits(spread.astype(float), struck, np.full(spread.shape, incidence), labels)


def through(seen: Hits, errors: str = "none", **receiver: Any) -> Floats:
    model = open_error_model(errors, {"receiver": receiver})
    return model.perturb_ranges(seen, VLP16, Draws(np.random.default_rng(3)))


def returned(seen: Hits, **receiver: Any) -> NDArray[np.bool_]:
    """Whether all rays of each distance returned; none in between."""
    finite = np.isfinite(through(seen, **receiver))
    assert (finite.all(axis=(1, 2)) == finite.any(axis=(1, 2))).all()
    return np.asarray(finite.all(axis=(1, 2)))


@pytest.mark.parametrize(
    "errors", sorted(set(error_model_names()) - {"calibrated", "distance_table"})
)
def test_a_receiver_as_it_stands_changes_no_byte(errors: str) -> None:
    seen = hits([1.0, 49.0, 99.0, np.inf], incidence=0.7)
    bare = open_error_model(errors).perturb_ranges(seen, VLP16, Draws(np.random.default_rng(3)))
    assert np.array_equal(through(seen, errors), bare)


def test_a_dark_thing_returns_from_as_far_as_blensors_line_allows() -> None:
    """Reflectivity 0.2 is 0.1 + 0.01 (60 - 50)."""
    near_and_far = hits([10.0, 49.9, 50.0, 59.9, 60.1, 99.0])
    seen = returned(near_and_far, default_reflectivity=0.2)
    assert seen.tolist() == [True, True, True, True, False, False]
    assert returned(hits([49.9, 50.0]), default_reflectivity=0.0).tolist() == [True, False]
    assert returned(hits([50.0, 50.1]), default_reflectivity=0.1).tolist() == [True, False]


def test_reflectivity_goes_by_name_then_class_then_default() -> None:
    options = {"reflectivity": {"sofa": 0.15, "sofa_2": 0.3}, "default_reflectivity": 0.05}
    reach = {0: 0, 1: 55, 2: 70, 3: 0}
    for triangle, farthest in reach.items():
        seen = returned(hits([51.0, 54.9, 55.1, 69.9, 70.1], triangle=triangle), **options)
        assert seen.tolist() == [distance < farthest for distance in (51, 54.9, 55.1, 69.9, 70.1)]


def test_a_mesh_without_labels_has_no_reflectivity_by_class() -> None:
    with pytest.raises(InputError, match="the mesh has no labels"):
        through(hits(60.0, labels=None), reflectivity={"sofa": 0.2})


@pytest.mark.parametrize(
    ("distance", "incidence", "chance"), [(1, 0, 0.15), (20, 0, 0.34), (20, np.pi / 3, 0.54)]
)
def test_raydrop_grows_with_incidence_and_range(
    distance: float, incidence: float, chance: float
) -> None:
    seen = hits(np.full(50, distance), incidence)
    drop = {"raydrop": 0.14, "raydrop_per_m": 0.01, "raydrop_incidence": 0.4}
    lost = ~np.isfinite(through(seen, **drop))
    assert lost.mean() == pytest.approx(chance, abs=4 * np.sqrt(0.25 / lost.size))


def test_ranges_are_multiples_of_the_quantum() -> None:
    result = through(hits(np.linspace(1, 90, 40)), "vlp16", range_quantum_mm=2)
    exact = through(hits(np.linspace(1, 90, 40)), "vlp16")
    assert result == pytest.approx(np.round(result * 500) / 500, abs=1e-12)
    assert (result - exact).std() == pytest.approx(0.002 / np.sqrt(12), rel=0.02)
    assert np.abs(result - exact).max() <= 0.001 + 1e-12


def test_measured_ranges_below_the_least_are_lost() -> None:
    result = through(hits([0.5, 0.7, 0.9]), min_range_m=0.7)
    assert np.isfinite(result[:, 0, 0]).tolist() == [False, True, True]


def test_effects_go_together_and_on_top_of_the_models_noise() -> None:
    seen = hits(np.full(50, 5.0))
    result = through(seen, "vlp16", raydrop=0.5, range_quantum_mm=2, min_range_m=5)
    kept = result[np.isfinite(result)]
    assert kept.min() >= 5
    assert kept.size == pytest.approx(result.size / 4, rel=0.1)


def test_a_model_is_described_with_its_receiver() -> None:
    model = open_error_model("none", {"receiver": {"raydrop": 0.1}})
    assert model.described()["model"] == "NoErrors"
    assert model.described()["receiver"]["raydrop"] == 0.1
    assert "receiver" not in open_error_model("none").described()
