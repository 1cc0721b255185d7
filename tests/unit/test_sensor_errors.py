from typing import Any

import numpy as np
import pytest

from puckbench.errors import InputError
from puckbench.sensor import error_model_names, load_sensor, open_error_model
from puckbench.sensor.errors import Draws, Hits
from puckbench.sensor.sweep import Sweep

VLP16 = load_sensor("vlp16")


def missing(frames: int = 2, steps: int = 3) -> Hits:
    shape = (frames, steps, 16)
    nowhere = np.zeros(shape, dtype=np.uint32)
    return Hits(np.full(shape, np.inf), nowhere, np.full(shape, np.nan))


@pytest.mark.parametrize("name", error_model_names())
def test_a_missed_ray_gets_no_noise(name: str) -> None:
    distances = open_error_model(name).perturb_ranges(
        missing(), VLP16, Draws(np.random.default_rng(0))
    )
    assert np.isinf(distances).all()


@pytest.mark.parametrize("name", error_model_names())
def test_hooks_leave_their_arguments_as_they_are(name: str) -> None:
    model, draws = open_error_model(name), Draws(np.random.default_rng(0))
    rays = Sweep().rays(VLP16, range(3))
    yaw, hits = rays.yaw.copy(), missing()
    hits.distance[:] = 5.0
    fired = model.perturb_rays(rays, VLP16, draws)
    model.perturb_ranges(hits, VLP16, draws)
    assert np.array_equal(rays.yaw, yaw)
    assert (hits.distance == 5).all()
    assert fired.yaw.shape == fired.pitch.shape == rays.yaw.shape


def test_streams_run_on_and_can_be_had_from_their_start() -> None:
    draws, again = Draws(np.random.default_rng(3)), Draws(np.random.default_rng(3))
    split = [draws.running("a").standard_normal(4), draws.running("a").standard_normal(6)]
    assert np.array_equal(np.concatenate(split), again.running("a").standard_normal(10))
    assert np.array_equal(draws.fixed("a").random(3), draws.fixed("a").random(3))
    assert not np.array_equal(draws.fixed("a").random(3), draws.fixed("b").random(3))


@pytest.mark.parametrize(
    ("name", "options", "fault"),
    [
        ("vlp17", {}, "unknown error model 'vlp17' (known: none, vlp16, vlp16_divergence"),
        ("none", {"ray_sigma_m": 1}, "error model none: unknown option 'ray_sigma_m'"),
        ("vlp16", {"sigma": 1}, "unknown option 'sigma' (known: bias_sigma_m, ray_sigma_m"),
        ("vlp16", {"ray_sigma_m": "1 cm"}, "ray_sigma_m is '1 cm', but must be a finite number"),
        ("vlp16", {"ray_sigma_m": -0.1}, "ray_sigma_m is -0.1, but must be at least 0"),
        ("vlp16", {"bias_redrawn": "never"}, "must be 'frame' or 'scan'"),
        ("vlp16_divergence", {"returns_along": "both"}, "must be 'fired' or 'nominal'"),
        ("vlp16_divergence", {"yaw_width_deg": -1}, "yaw_width_deg is -1.0"),
    ],
)
def test_an_unknown_model_or_option_is_named_in_one_line(
    name: str, options: dict[str, Any], fault: str
) -> None:
    with pytest.raises(InputError) as caught:
        open_error_model(name, options)
    assert fault in str(caught.value)
    assert "\n" not in str(caught.value)
