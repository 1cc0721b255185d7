"""PCQM against the program of its authors, and against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from pointkit.geometry.cloud import PointCloud
from puckbench.metrics.metric_registry import further_metrics
from puckbench.metrics.pcqm import lightness, pcqm


def strip(seed: int, count: int) -> PointCloud:
    """A wavy strip with coloured waves, whose box begins at the origin."""
    random = np.random.default_rng(seed)
    u, v = random.random((2, count)) * [[1.0], [0.02]]
    u[0], v[0], u[1] = 0, 0, 1
    z = 0.01 + 0.01 * np.sin(40 * u) * np.cos(90 * v)
    waves = np.column_stack([np.sin(11 * u), np.cos(50 * v), np.sin(3 * u + 80 * v)])
    points = np.column_stack([u, v, z]).astype(np.float32).astype(float)
    return PointCloud(points, colours=(127 + 100 * waves).astype(np.uint8))


STRIP = strip(1, 4000)
_RANDOM = np.random.default_rng(2)
MOVED = (STRIP.xyz.astype(np.float32) + _RANDOM.normal(0, 2e-4, (4000, 3))).astype(np.float32)
MOVED = MOVED.astype(float)
assert STRIP.colours is not None
COLOURS = np.clip(STRIP.colours + _RANDOM.integers(-40, 41, (4000, 3)), 0, 255).astype(np.uint8)

PROGRAM = {
    "moved": (PointCloud(MOVED, colours=STRIP.colours), 0.00483917),
    "recoloured": (PointCloud(STRIP.xyz, colours=COLOURS), 0.0138781),
    "both": (PointCloud(MOVED, colours=COLOURS), 0.0189407),
    "other": (strip(3, 2000), 0.00560162),
    "few": (strip(4, 60), 0.0223264),
}
"""Clouds, and the PCQM that the program at github.com/MEPP-team/PCQM (2a2c410) prints for STRIP and
each of them."""


@pytest.mark.parametrize("name", PROGRAM)
def test_pcqm_is_that_of_the_authors_program(name: str) -> None:
    decoded, expected = PROGRAM[name]
    assert pcqm(STRIP, decoded) == pytest.approx(expected, rel=3e-5)


def test_equal_clouds_have_no_error_in_any_order_and_with_duplicates() -> None:
    order = np.random.default_rng(0).permutation(np.append(np.arange(4000), 7))
    assert pcqm(STRIP, STRIP.select(order)) == pytest.approx(0, abs=1e-12)


def test_white_for_black_is_an_error_of_lightness_alone() -> None:
    """Both clouds are even: only the likeness of the lightness differs, 1 / (0.002 dL² + 1)."""
    black, white = (np.full((4000, 3), value, np.uint8) for value in (0, 255))
    clouds = [PointCloud(STRIP.xyz, colours=colours) for colours in (black, white)]
    light = 75.1532  # of L* = 100 in the authors' table; that of white is 99.998
    assert lightness(np.array([[0.0] * 3, [255.0] * 3])) == pytest.approx([0, light], abs=2e-3)
    assert pcqm(*clouds) == pytest.approx(0.9771 * (1 - 1 / (0.002 * light**2 + 1)), rel=1e-5)


def test_pcqm_does_not_depend_on_scale_and_place() -> None:
    decoded = PROGRAM["both"][0]
    scaled = [PointCloud(64 * c.xyz - 100, colours=c.colours) for c in (STRIP, decoded)]
    assert pcqm(*scaled) == pytest.approx(pcqm(STRIP, decoded), rel=1e-3)


def test_the_metric_is_a_column_and_is_empty_without_colours_or_neighbours() -> None:
    decoded = PROGRAM["few"][0]
    (value,) = further_metrics(["pcqm"], STRIP, decoded, ()).values()
    assert value == pcqm(STRIP, decoded)
    bare, tiny = PointCloud(decoded.xyz), decoded.select(np.arange(19))
    for other in (bare, tiny):
        assert further_metrics(["pcqm"], STRIP, other, ()) == {}
