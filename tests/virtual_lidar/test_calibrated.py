from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from pointkit.lidar.sensors import load_sensor
from virtual_lidar import open_error_model
from virtual_lidar.errors import Draws, Hits

VLP16 = load_sensor("vlp16")
EVERY_KIND = {
    "laser_sigma_m": 0.008,
    "scan_sigma_m": 0.004,
    "frame_sigma_m": 0.003,
    "ray_sigma_m": 0.006,
}


def errors(
    options: dict[str, Any],
    *,
    scan: int = 0,
    distance: float = 2.0,
    incidence: float = 0.0,
    frames: int = 300,
    steps: int = 40,
) -> Floats:
    """Noisy less true distances, (frames, steps, lasers)."""
    shape = (frames, steps, 16)
    hits = Hits(
        np.full(shape, distance), np.zeros(shape, dtype=np.uint32), np.full(shape, incidence)
    )
    model = open_error_model("calibrated", options)
    return model.perturb_ranges(hits, VLP16, Draws(np.random.default_rng(scan))) - distance


def model_file(path: Path, **parameters: Any) -> Path:
    content = {"format": "puckbench range error model 1", "parameters": parameters}
    path.write_text(yaml.safe_dump(content))
    return path


def test_each_sigma_is_that_of_its_own_kind_of_draw() -> None:
    scans = [errors({**EVERY_KIND, "device": 1 + scan}, scan=scan) for scan in range(60)]
    rays = np.mean([item.std(axis=1).mean() for item in scans])
    assert rays == pytest.approx(0.006, rel=0.02)
    cells = [item.mean(axis=1) for item in scans]
    frames = np.mean([item.var(axis=0, ddof=1).mean() for item in cells])
    assert np.sqrt(frames - 0.006**2 / 40) == pytest.approx(0.003, rel=0.02)
    lasers = np.std([item.mean(axis=0) for item in cells])
    assert lasers == pytest.approx(np.hypot(0.008, 0.004), rel=0.08)


def test_a_numbered_device_is_the_same_in_every_scan_and_another_is_not() -> None:
    def biases(device: int | None, scan: int) -> Floats:
        only_lasers = {"laser_sigma_m": 0.008, "ray_sigma_m": 0.0, "device": device}
        return errors(only_lasers, scan=scan, frames=1, steps=1)[0, 0]

    assert np.array_equal(biases(3, scan=1), biases(3, scan=2))
    assert not np.array_equal(biases(3, scan=1), biases(4, scan=1))
    assert not np.array_equal(biases(None, scan=1), biases(None, scan=2))


def test_a_measured_device_has_its_own_biases() -> None:
    own = np.linspace(-0.01, 0.01, 16)
    measured = {"bias_m": own.tolist(), "laser_sigma_m": 0.5, "ray_sigma_m": 0.0}
    for device in (None, 0):
        assert errors({**measured, "device": device}, frames=2)[1, 0] == pytest.approx(own)
    assert np.abs(errors({**measured, "device": 1})).max() > 0.1


def test_lasers_that_were_not_measured_are_drawn() -> None:
    some = {"bias_m": [0.001, 0.002], "laser_sigma_m": 0.008, "ray_sigma_m": 0.0}
    result = errors(some, frames=1, steps=1)[0, 0]
    assert result[:2] == pytest.approx([0.001, 0.002])
    assert 0.003 < result[2:].std() < 0.015


@pytest.mark.parametrize(
    ("distance", "incidence", "sigma"),
    [
        (2.0, 0.0, 0.0064),
        (2.0, 1.0, 0.0084),
        (2.0, 1.5, 0.0084),
        (50.0, 0.0, 0.008),
        (0.1, 0.0, 0.0062),
    ],
)
def test_a_rays_sigma_goes_no_further_than_it_was_calibrated(
    distance: float, incidence: float, sigma: float
) -> None:
    options = {"ray_sigma_m": 0.006, "ray_incidence_m": 0.002, "ray_range": 0.0002}
    domain = {"most_incidence_rad": 1.0, "ranges_m": [1.0, 10.0]}
    result = errors({**options, **domain}, distance=distance, incidence=incidence)
    assert result.std() == pytest.approx(sigma, rel=0.01)


def test_laplace_noise_has_the_standard_deviation_given() -> None:
    result = errors({"ray_sigma_m": 0.006, "ray_distribution": "laplace"})
    assert result.std() == pytest.approx(0.006, rel=0.01)
    assert np.mean(result**4) / result.var() ** 2 == pytest.approx(6, rel=0.05)


def test_a_file_holds_the_parameters_and_an_option_goes_before_it(tmp_path: Path) -> None:
    path = model_file(tmp_path / "m.yaml", laser_sigma_m=0.008, ray_sigma_m=0.006)
    model = vars(open_error_model("calibrated", {"file": str(path), "ray_sigma_m": 0.001}))
    assert (model["laser_sigma_m"], model["ray_sigma_m"]) == (0.008, 0.001)


def test_the_shipped_model_has_the_published_size() -> None:
    model = vars(open_error_model("vlp16_measured"))
    # Found before on four captures: bias 7-8 mm, ray 6.3 mm.
    assert np.hypot(model["laser_sigma_m"], model["scan_sigma_m"]) == pytest.approx(0.008, abs=2e-3)
    assert model["ray_sigma_m"] == pytest.approx(0.0063, abs=5e-4)
    assert model["bias_m"] is None


@pytest.mark.parametrize(
    ("options", "fault"),
    [
        ({}, "set file, or ray_sigma_m"),
        ({"file": "nowhere.yaml"}, "nowhere.yaml: no such file"),
        ({"file": "unknown"}, "unknown.yaml: no such file"),
        ({"ray_sigma_m": -0.1}, "ray_sigma_m is -0.1"),
        ({"ray_sigma_m": 0.1, "device": 0}, "bias_m of a measured device is not given"),
        ({"ray_sigma_m": 0.1, "ranges_m": [2, 1]}, "ranges_m must be"),
        ({"ray_sigma_m": 0.1, "ray_distribution": "cauchy"}, "'cauchy'"),
    ],
)
def test_bad_options_are_one_line(options: dict[str, Any], fault: str) -> None:
    with pytest.raises(InputError, match=fault) as caught:
        open_error_model("calibrated", options)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("a: [", "not valid YAML"),
        ("a: 1", "not a model file"),
        ("format: puckbench range error model 1\nparameters: {}", "no ray_sigma_m"),
        (
            "format: puckbench range error model 1\nparameters: {ray_sigma_m: x}",
            "ray_sigma_m is 'x'",
        ),
        (
            "format: puckbench range error model 1\nparameters: {ray_sigma_m: 0.1, wobble: 1}",
            "unknown option 'wobble'",
        ),
        (
            "format: puckbench range error model 1\nparameters: {ray_sigma_m: 0.1, file: a}",
            "unknown parameter 'file'",
        ),
    ],
)
def test_files_that_are_no_models_are_refused(text: str, fault: str, tmp_path: Path) -> None:
    path = tmp_path / "m.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=fault) as caught:
        open_error_model("calibrated", {"file": str(path)})
    assert str(path) in str(caught.value)


def test_more_lasers_than_the_sensor_has_are_refused() -> None:
    with pytest.raises(InputError, match="bias_m has 17 lasers, the sensor 16"):
        errors({"ray_sigma_m": 0.0, "bias_m": [0.0] * 17})
