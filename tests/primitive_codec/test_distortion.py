"""The encoder's estimate of distortion."""

import numpy as np
import pytest

from primitive_codec.distortion import DistortionEstimator


def test_the_distortion_estimate_tells_noise_from_error() -> None:
    u, v = np.meshgrid(np.arange(0, 60, 0.5), np.arange(0, 60, 0.5))
    true = np.column_stack([u.ravel(), v.ravel(), np.zeros(u.size)])
    noise = np.random.default_rng(3).normal(0, 0.2, len(true))
    noisy = true + noise[:, None] * [0.0, 0.0, 1.0]
    samples = true[::7]
    up = np.tile([0.0, 0.0, 1.0], (len(samples), 1))
    estimator = DistortionEstimator.of(noisy, samples, up, np.full(len(samples), 1 / len(samples)))
    same, smooth = estimator.measure(noisy), estimator.measure(true)
    assert same.plane == same.point == 0
    assert smooth.plane == pytest.approx(0.04, rel=0.1)
    assert smooth.surface == 0
    assert same.surface == pytest.approx(0.04, rel=0.15)


def test_the_distortion_estimate_weighs_samples_by_their_points() -> None:
    u, v = np.meshgrid(np.arange(0, 60, 2.0), np.arange(0, 60, 2.0))
    samples = np.column_stack([u.ravel(), v.ravel(), np.zeros(u.size)])
    dense = samples[:, 0] < 30
    weights = np.where(dense, 0.9, 0.1) / dense.sum()
    up = np.tile([0.0, 0.0, 1.0], (len(samples), 1))
    estimator = DistortionEstimator.of(samples, samples, up, weights)
    lifted = samples + np.where(dense, 0.0, 1.0)[:, None] * [0.0, 0.0, 1.0]
    assert estimator.surface_error(lifted) == pytest.approx((0.1 + 0.5) / 2, abs=0.01)
