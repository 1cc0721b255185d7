"""What a calibration's model file says, and how residual tables are read by default."""

from __future__ import annotations

from dataclasses import replace
from importlib.metadata import version
from typing import Any

import pytest

from virtual_lidar.calibration.calibrating import Calibration, CalibrationOptions, RayShape
from virtual_lidar.calibration.files import model_file, settings_for
from virtual_lidar.calibration.fitting import Estimate
from virtual_lidar.calibration.likelihood import NAMES
from virtual_lidar.residual_table import REAL

LASERS, FRAMES, RAY = "laser_sigma_m", "frame_sigma_m", "ray_sigma_m"
FOUND = Calibration(
    sigmas={
        LASERS: Estimate(0.01, 0.0072, 0.015),
        FRAMES: Estimate(0.003, 0.002, 0.0041234567),
        RAY: Estimate(0.0061234567, 0.006, 0.0062),
    },
    biases=(Estimate(0.005, 0.004, 0.006), Estimate(-0.005, -0.006, -0.004)),
    mean=Estimate(0.002, 0.001, 0.003),
    shape=RayShape("laplace", 12.34, 5.678),
    settings=CalibrationOptions(quantum_m=0.002),
    laser_ids=(1, 3),
    most_incidence_rad=0.7,
    ranges_m=(1.0, 9.5),
    counts={"lasers": 2},
)


def test_a_model_file_says_what_was_found_to_the_micrometre_and_from_what() -> None:
    source = {"file": "r.parquet", "sha256": "0f"}
    assert model_file(FOUND, [source]) == {
        "format": "puckbench range error model 1",
        "parameters": {
            LASERS: 0.01,
            FRAMES: 0.003,
            RAY: 0.006123,
            "ray_distribution": "laplace",
            "range_mean_m": 0.002,
            "most_incidence_rad": 0.7,
            "ranges_m": [1.0, 9.5],
            # Lasers that were not seen may have any bias: twice the sigma either way.
            "bias_m": [0.0, 0.005, 0.0, -0.005],
        },
        "intervals_95": {
            LASERS: [0.0072, 0.015],
            FRAMES: [0.002, 0.004123],
            RAY: [0.006, 0.0062],
            "range_mean_m": [0.001, 0.003],
            "bias_m": [[-0.02, 0.02], [0.004, 0.006], [-0.02, 0.02], [-0.006, -0.004]],
        },
        "ray_noise": {"kurtosis": 5.68, "log_likelihood_laplace_over_gaussian": 12.3},
        "provenance": {
            "tables": [source],
            "counts": {"lasers": 2},
            "cells": "frame",
            "estimated": [LASERS, FRAMES, RAY],
            "quantum_m": 0.002,
            "version": version("virtual_lidar"),
        },
    }


@pytest.mark.parametrize(
    ("low", "high", "written"),
    [
        (0.001, 0.003, 0.002),
        (-0.003, -0.001, -0.002),
        (-0.001, 0.005, 0.0),
        (0.0, 0.004, 0.0),
        (-0.004, 0.0, 0.0),
    ],
)
def test_a_mean_that_may_be_zero_is_written_as_zero(
    low: float, high: float, written: float
) -> None:
    mean = Estimate((low + high) / 2, low, high)
    content = model_file(replace(FOUND, mean=mean), [])
    assert content["parameters"]["range_mean_m"] == pytest.approx(written)
    assert content["intervals_95"]["range_mean_m"] == [low, high]


def test_what_the_planes_hide_and_several_devices_have_not_is_left_out() -> None:
    content = model_file(replace(FOUND, mean=None, biases=()), [])
    assert content["parameters"]["range_mean_m"] == 0
    assert "bias_m" not in content["parameters"]
    assert not {"bias_m", "range_mean_m"} & set(content["intervals_95"])


def test_without_a_sigma_of_lasers_one_that_was_not_seen_has_no_bias() -> None:
    content = model_file(replace(FOUND, sigmas={RAY: FOUND.sigmas[RAY]}), [])
    assert content["parameters"]["bias_m"] == [0.0, 0.005, 0.0, -0.005]
    assert content["intervals_95"]["bias_m"][0] == [0.0, 0.0]


def test_what_spots_share_is_the_walls_unevenness_and_no_error_of_the_sensor() -> None:
    spots = replace(FOUND, settings=CalibrationOptions(cells="spot"))
    content = model_file(spots, [])
    assert FRAMES not in {**content["parameters"], **content["intervals_95"]}
    assert content["intervals_95"]["unevenness_of_the_walls_m"] == [0.002, 0.003, 0.004123]
    assert content["provenance"]["cells"] == "spot"
    even = model_file(replace(spots, sigmas={RAY: FOUND.sigmas[RAY]}), [])
    assert list(even["intervals_95"]) == [RAY, "range_mean_m", "bias_m"]


@pytest.mark.parametrize(
    ("model", "given", "expected"),
    [
        ("vlp16", {}, CalibrationOptions("frame", NAMES, 0.0)),
        (REAL, {}, CalibrationOptions("spot", NAMES, 0.002)),
        (REAL, {"quantum_mm": 0.0}, CalibrationOptions("spot", NAMES, 0.0)),
        ("vlp16", {"quantum_mm": 5.0}, CalibrationOptions("frame", NAMES, 0.005)),
        (REAL, {"cells": "frame", "parameters": [RAY]}, CalibrationOptions("frame", (RAY,), 0.002)),
    ],
)
def test_recordings_are_read_by_spots_and_steps_of_two_millimetres(
    model: str, given: dict[str, Any], expected: CalibrationOptions
) -> None:
    assert settings_for(model, **given) == expected
