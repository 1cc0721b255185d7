"""Signal-to-noise ratios by hand."""

import math

import pytest

from puckbench.metrics.psnr import cd_psnr, mpeg_psnr, psnr


def test_a_thousandth_of_the_peak_is_sixty_decibels() -> None:
    assert psnr(1.0, 1000.0) == pytest.approx(60)


def test_no_error_is_infinitely_good() -> None:
    assert psnr(0.0, 1023.0) == math.inf


def test_chamfer_psnr_takes_the_diameter_as_peak() -> None:
    values = cd_psnr({"cd_point": 4.0, "cd_plane": 1.0}, diameter=200.0)
    assert values == pytest.approx({"cd_psnr_point": 40.0, "cd_psnr_plane": 20 * math.log10(200)})


def test_mpeg_psnr_has_a_factor_of_three() -> None:
    assert mpeg_psnr({"d1_mse": 3.0}, peak=100.0) == pytest.approx({"d1_psnr": 40.0})


def test_without_a_width_nothing_is_good() -> None:
    assert psnr(1.0, 0.0) == -math.inf
