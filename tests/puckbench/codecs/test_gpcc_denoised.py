"""Denoising before G-PCC, on a noisy plane whose surface is known."""

import numpy as np
import pytest

from pointkit.geometry.cloud import PointCloud
from puckbench.codecs.registry import open_codec
from tests.support.codecs import decode, decode_cloud, encode, encode_cloud

pytest.importorskip("CGAL")


def _plane(points: int = 5000, sigma: float = 4.0) -> np.ndarray:
    rng = np.random.default_rng(3)
    xyz = rng.random((points, 3)) * 1000
    xyz[:, 2] = 500 + rng.normal(0, sigma, points)
    return xyz


def test_noise_of_a_plane_falls_as_that_of_a_fitted_quadric() -> None:
    """A quadric with 6 coefficients in 45 points leaves sqrt(6 / 45) of the noise or more, since
    the fit is evaluated in the middle of its points."""
    decoded = decode(
        open_codec("gpcc_denoised"), encode(open_codec("gpcc_denoised"), _plane(), "r8")
    )
    rounding = 1 / np.sqrt(12)
    assert np.hypot(4 * np.sqrt(6 / 45) / 2, rounding) < decoded[:, 2].std() < 4 * np.sqrt(6 / 45)


def test_other_numbers_of_neighbours_remove_other_shares() -> None:
    few, many = (
        open_codec("gpcc_denoised", {"options": {"neighbours": neighbours}})
        for neighbours in (10, 200)
    )
    spread = [decode(codec, encode(codec, _plane(), "r8"))[:, 2].std() for codec in (few, many)]
    assert spread[1] < spread[0] / 2


def test_clouds_without_a_surface_stay_as_they_are() -> None:
    codec = open_codec("gpcc_denoised")
    for points in (np.full((100, 3), 7.0), np.arange(100.0)[:, None] * [1, 0, 0], np.eye(3)):
        decoded = decode(codec, encode(codec, points, "r8"))
        assert np.array_equal(np.unique(decoded, axis=0), np.unique(points, axis=0))


def test_reflectances_are_those_of_the_denoised_points() -> None:
    codec = open_codec("gpcc_denoised", {"options": {"attributes": True}})
    values = np.arange(5000) % 251
    cloud = PointCloud(_plane(), fields={"reflectance": values}, about={"size": 1024})
    stream = encode_cloud(codec, cloud, "r8")
    plain = encode(open_codec("gpcc_denoised"), _plane(), "r8")
    decoded = decode_cloud(codec, stream)
    assert np.array_equal(np.unique(decoded.xyz, axis=0), np.unique(decode(codec, plain), axis=0))
    assert "reflectance" in decoded.fields
