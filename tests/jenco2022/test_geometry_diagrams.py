"""The drawings of geometry are true to scale: rays end on surfaces, residuals are e cos(theta)."""

import numpy as np
import pytest

from jenco2022.figures.geometry_diagrams import ray_end, residual_of
from puckbench.figures.registry import figure_entry
from puckbench.figures.style import FigureStyle

BLUE, RED = "#0072B2", "#D55E00"


def drawn(name: str) -> list[tuple[str, np.ndarray]]:
    style = FigureStyle()
    with style.context():
        (axes,) = figure_entry(name).draw(style=style).axes
    assert axes.get_aspect() == 1.0
    return [(line.get_color(), np.asarray(line.get_xydata())) for line in axes.get_lines()]


@pytest.mark.parametrize(
    ("angle_deg", "end"),
    [(0, (3, 1)), (-45, (1, 0)), (-90, (0, 0)), (-10, (3, 1 - 3 * np.tan(np.radians(10))))],
)
def test_rays_end_on_wall_or_floor(angle_deg: float, end: tuple[float, float]) -> None:
    np.testing.assert_allclose(ray_end(np.radians(angle_deg)), end, atol=1e-9)


def test_rays_over_the_wall_stay_open() -> None:
    end = ray_end(np.radians(60))
    assert np.hypot(end[0], end[1] - 1) == pytest.approx(2.6)


def test_the_sweep_has_five_rays_at_each_of_three_pitches() -> None:
    rays = [line for _, line in drawn("fig_5_1") if np.allclose(line[0], (0, 1)) and len(line) == 2]
    pitches = [np.degrees(np.arctan2(*(end - start)[::-1])) for start, end in (ray for ray in rays)]
    offsets = np.reshape(pitches, (3, 5)) - np.array([[-60.0], [0.0], [60.0]])
    np.testing.assert_allclose(offsets, np.tile([-15, -7, 1, 7, 15], (3, 1)), atol=1e-9)


def test_figure_5_21_has_one_range_error_and_two_residuals() -> None:
    lines = drawn("fig_5_21")
    residuals = [np.ptp(line[:, 1]) for colour, line in lines if colour == RED]
    noisy = [line[0] for colour, line in lines if colour == BLUE]
    hits = [line[0] for colour, line in lines if colour == "white"]
    errors = [np.linalg.norm(a - b) for a, b in zip(noisy, hits, strict=True)]
    assert errors[0] == pytest.approx(errors[1])
    expected = [residual_of(errors[0], np.radians(angle)) for angle in (68, 25)]
    np.testing.assert_allclose(residuals, expected)
    assert residuals[0] < residuals[1] / 2


def test_a_residual_is_the_range_error_times_the_cosine_of_incidence() -> None:
    assert residual_of(0.02, np.pi / 3) == pytest.approx(0.01)
