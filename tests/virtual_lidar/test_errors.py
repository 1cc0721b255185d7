from typing import Any

import numpy as np
import pytest

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from pointkit.lidar.sensors import load_sensor
from virtual_lidar import error_model_names, open_error_model
from virtual_lidar.errors import Draws, ErrorModel, Hits
from virtual_lidar.sweep import Sweep

VLP16 = load_sensor("vlp16")


def missing(frames: int = 2, steps: int = 3) -> Hits:
    shape = (frames, steps, 16)
    nowhere = np.zeros(shape, dtype=np.uint32)
    return Hits(np.full(shape, np.inf), nowhere, np.full(shape, np.nan))


TABLE = [[1, 0.0, 0.01], [3, 0.02, 0.03], [4, -0.02, 0.03]]
NEEDED: dict[str, dict[str, Any]] = {
    "distance_table": {"table": TABLE},
    "calibrated": {"ray_sigma_m": 0.006},
}


def opened(name: str, **options: Any) -> ErrorModel:
    return open_error_model(name, {**NEEDED.get(name, {}), **options})


def errors(
    name: str, distance: float = 5.0, incidence: float = 0.0, frames: int = 1000, **options: Any
) -> Floats:
    """Noisy less true distances on an endless wall, (frames, steps, lasers)."""
    shape = (frames, 50, 16)
    hits = Hits(
        np.full(shape, distance), np.zeros(shape, dtype=np.uint32), np.full(shape, incidence)
    )
    draws = Draws(np.random.default_rng(7))
    noisy: Floats = opened(name, **options).perturb_ranges(hits, VLP16, draws) - distance
    return noisy


@pytest.mark.parametrize("name", error_model_names())
def test_a_missed_ray_gets_no_noise(name: str) -> None:
    distances = opened(name).perturb_ranges(missing(), VLP16, Draws(np.random.default_rng(0)))
    assert np.isinf(distances).all()


@pytest.mark.parametrize("name", error_model_names())
def test_hooks_leave_their_arguments_as_they_are(name: str) -> None:
    model, draws = opened(name), Draws(np.random.default_rng(0))
    rays = Sweep().rays(VLP16, range(3))
    yaw, hits = rays.yaw.copy(), missing()
    hits.distance[:] = 5.0
    fired = model.perturb_rays(rays, VLP16, draws)
    model.perturb_ranges(hits, VLP16, draws)
    assert np.array_equal(rays.yaw, yaw)
    assert (hits.distance == 5).all()
    assert fired.yaw.shape == fired.pitch.shape
    assert fired.yaw.shape[:2] == rays.yaw.shape[:2]
    assert fired.yaw.shape[2] % rays.yaw.shape[2] == 0


# A sample's standard deviation errs by 1 / sqrt(2 n): 0.56 % of 16,000 biases, 0.08 % of 800,000
# rays; a Laplace sample's by sqrt(5 / 4n). Tolerances are at least three times that.
@pytest.mark.parametrize(
    ("name", "bias_sigma", "ray_sigma"),
    [
        ("vlp16", 0.014, 0.010),
        ("vlp16_divergence", 0.014, 0.010),
        ("vlp16_table51", 0.078, 0.014),
        ("hdl64e", 0.078, 0.010),
        ("thesis_room", 0.014, 0.020),
        ("vlp16_incidence", 0.014, 0.010),
    ],
)
def test_biases_and_rays_have_the_published_sigmas(
    name: str, bias_sigma: float, ray_sigma: float
) -> None:
    result = errors(name)
    bias = result.mean(axis=1, keepdims=True)
    assert (result - bias).std() * np.sqrt(50 / 49) == pytest.approx(ray_sigma, rel=0.003)
    assert bias.std() == pytest.approx(np.hypot(bias_sigma, ray_sigma / np.sqrt(50)), rel=0.017)
    assert result.mean() == pytest.approx(0, abs=4 * bias_sigma / np.sqrt(16_000))


@pytest.mark.parametrize("degrees", [0.0, 30.0, 60.0, 85.0])
def test_sigma_grows_with_the_square_of_the_incidence(degrees: float) -> None:
    theta = np.radians(degrees)
    result = errors("vlp16_incidence", incidence=theta, bias_sigma_m=0)
    assert result.std() == pytest.approx(0.010 + (0.1 * theta) ** 2, rel=0.003)
    flat = errors("vlp16_incidence", incidence=theta, incidence_factor=0)
    assert np.array_equal(flat, errors("vlp16"))


def test_laplace_noise_reads_sigma_as_b() -> None:
    rays = errors("vlp16", bias_sigma_m=0, ray_distribution="laplace")
    assert rays.std() == pytest.approx(0.010 * np.sqrt(2), rel=0.005)
    assert np.abs(rays).mean() == pytest.approx(0.010, rel=0.005)
    bias = errors("vlp16", ray_sigma_m=0, bias_distribution="laplace")[:, 0]
    assert np.abs(bias).mean() == pytest.approx(0.014, rel=0.03)
    assert np.median(np.abs(bias)) == pytest.approx(0.014 * np.log(2), rel=0.03)


def test_a_mean_shifts_every_range() -> None:
    result = errors("vlp16", ray_mean_m=0.05)
    assert result - errors("vlp16") == pytest.approx(0.05, abs=1e-12)


@pytest.mark.parametrize(
    ("distance", "mean", "sigma"),
    [(0.5, 0, 0.01), (1.5, 0.005, 0.015), (3.5, 0, 0.03), (9, -0.02, 0.03)],
)
def test_mean_and_sigma_are_interpolated_over_the_distance(
    distance: float, mean: float, sigma: float
) -> None:
    result = errors("distance_table", distance)
    assert result.mean() == pytest.approx(mean, abs=4 * sigma / np.sqrt(800_000))
    assert result.std() == pytest.approx(sigma, rel=0.003)


def test_streams_run_on_and_can_be_had_from_their_start() -> None:
    draws, again = Draws(np.random.default_rng(3)), Draws(np.random.default_rng(3))
    split = [draws.running("a").standard_normal(4), draws.running("a").standard_normal(6)]
    assert np.array_equal(np.concatenate(split), again.running("a").standard_normal(10))
    assert np.array_equal(draws.fixed("a").random(3), draws.fixed("a").random(3))
    assert not np.array_equal(draws.fixed("a").random(3), draws.fixed("b").random(3))


@pytest.mark.parametrize(
    ("name", "options", "fault"),
    [
        ("vlp17", {}, "unknown error model 'vlp17' (known: beam_footprint, calibrated, "),
        ("none", {"ray_sigma_m": 1}, "error model none: unknown option 'ray_sigma_m'"),
        ("vlp16", {"sigma": 1}, "unknown option 'sigma' (known: bias_sigma_m, ray_sigma_m"),
        ("vlp16", {"ray_sigma_m": "1 cm"}, "ray_sigma_m is '1 cm', but must be a valid number"),
        (
            "vlp16",
            {"ray_sigma_m": -0.1},
            "ray_sigma_m is -0.1, but must be greater than or equal to 0",
        ),
        ("vlp16", {"bias_redrawn": "never"}, "must be 'frame' or 'scan'"),
        ("vlp16_divergence", {"returns_along": "both"}, "must be 'fired' or 'nominal'"),
        ("vlp16", {"ray_distribution": "cauchy"}, "must be 'gaussian' or 'laplace'"),
        ("vlp16_incidence", {"incidence_factor": -1}, "incidence_factor is -1,"),
        ("distance_table", {}, "error model distance_table: the option 'table' is missing"),
        ("distance_table", {"table": []}, "table is empty"),
        ("distance_table", {"table": [1, 2]}, "table.0 is 1, but must be a list"),
        ("distance_table", {"table": [[1, 0]]}, "a row that is not distance, mu, sigma"),
        ("distance_table", {"table": [[1, 0, 1], [1, 0, 1]]}, "distances that do not increase"),
        ("distance_table", {"table": [[1, 0, -1]]}, "table has a sigma below 0"),
        ("none", {"receiver": 2}, "none: receiver is 2, but must be a mapping of options"),
        ("none", {"receiver": {"quantum": 2}}, "none: receiver: unknown option 'quantum'"),
        (
            "none",
            {"receiver": {"raydrop": -0.1}},
            "raydrop is -0.1, but must be gr",
        ),
        ("none", {"receiver": {"range_quantum_mm": 0}}, "must be greater than 0"),
        (
            "none",
            {"receiver": {"reflectivity": {"wall": 2}}},
            "reflectivity.wall is 2, but must",
        ),
        (
            "none",
            {"receiver": {"reflectivity": 2}},
            "reflectivity is 2, but must be",
        ),
        ("beam_footprint", {"sub_rays": 0}, "sub_rays is 0, but must be greater than 0"),
        (
            "beam_footprint",
            {"returns": "best"},
            "returns is 'best', but must be 'first'",
        ),
        ("surface_normal", {"normal_sigma_m": -1}, "normal_sigma_m is -1,"),
        ("vlp16_divergence", {"yaw_width_deg": -1}, "yaw_width_deg is -1,"),
    ],
)
def test_an_unknown_model_or_option_is_named_in_one_line(
    name: str, options: dict[str, Any], fault: str
) -> None:
    with pytest.raises(InputError) as caught:
        open_error_model(name, options)
    assert fault in str(caught.value)
    assert "\n" not in str(caught.value)


def test_streams_have_their_numbers_by_name_and_go_on() -> None:
    """The numbers themselves: other ones would change every scan."""
    draws = Draws(np.random.default_rng(0))
    assert draws.fixed("ray").integers(10**6, size=3).tolist() == [842967, 948836, 172850]
    assert draws.running("ray").integers(10**6, size=2).tolist() == [842967, 948836]
    assert draws.running("ray").integers(10**6) == 172850
    assert draws.fixed("frame").integers(10**6) == 665880


def test_a_model_is_described_by_its_class_and_parameters() -> None:
    result = open_error_model("vlp16", {"ray_mean_m": 0.002}).described()
    assert result["model"] == "Vlp16"
    assert result["ray_mean_m"] == 0.002
