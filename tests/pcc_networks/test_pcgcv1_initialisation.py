"""PCGCv1's initialisation, tested on another example than it was made with."""

import math

import pytest
import torch
from torch import nn

from pcc_networks.pcgcv1.model import PCGCv1, Pcgcv1Shape
from pcc_networks.pcgcv1.training import Pcgcv1Trainer, initialise, sphere
from pcc_networks.sparse.voxels import morton_keys, unique_keys
from pcc_networks.training.settings import Pcgcv1Training

pytestmark = pytest.mark.usefixtures("one_thread")
SIDE = 16


def _deviations(model: nn.Module, cubes: torch.Tensor) -> dict[str, float]:
    """Standard deviation of the output of each convolution."""
    result: dict[str, float] = {}

    def note(name: str) -> object:
        return lambda _layer, _inputs, output: result.update({name: float(output.std())})

    for name, layer in model.named_modules():
        if isinstance(layer, (nn.Conv3d, nn.ConvTranspose3d)):
            layer.register_forward_hook(note(name))
    with torch.no_grad():
        y = model.g_a(cubes)
        model.h_s(model.h_a(y))
        model.g_s(y)
    return result


def _plane() -> torch.Tensor:
    cubes = torch.zeros(1, 1, SIDE, SIDE, SIDE)
    cubes[:, :, 5] = 1
    return cubes


def test_no_layers_outputs_vanish_or_grow() -> None:
    torch.manual_seed(0)
    before, after = PCGCv1(Pcgcv1Shape(cube_size=SIDE)), PCGCv1(Pcgcv1Shape(cube_size=SIDE))
    initialise(after, SIDE)
    rounding = math.sqrt(1 / 12)
    assert _deviations(before, _plane())["g_a.conv_out"] < rounding / 2
    deviations = _deviations(after, _plane())
    assert 0.05 < min(deviations.values()) < max(deviations.values()) < 20
    assert deviations["g_a.conv_out"] > 5 * rounding


def test_outputs_for_a_sphere_have_the_wanted_deviations() -> None:
    torch.manual_seed(0)
    model = PCGCv1(Pcgcv1Shape(cube_size=SIDE))
    initialise(model, SIDE)
    deviations = _deviations(model, sphere(SIDE))
    assert deviations["g_a.conv_out"] == pytest.approx(4, rel=1e-3)
    assert deviations["g_s.conv_in"] == pytest.approx(1, rel=1e-3)
    assert model.g_s.conv_out.bias.item() == pytest.approx(-math.log(3))


def test_a_spheres_shell_is_one_voxel_thick() -> None:
    shell = sphere(32)[0, 0]
    assert 4 * math.pi * 12.8**2 == pytest.approx(float(shell.sum()), rel=0.1)
    assert shell[0].sum() == 0


def test_the_networks_learn_more_than_that_everything_is_empty() -> None:
    """Initialisation and rate warm-up together."""
    training = Pcgcv1Training(
        steps=60,
        cube_size=SIDE,
        batch_size=1,
        lmbdas=(2.0, 10.0),
        channels=(4, 8, 16),
        learning_rate=3e-3,
    )
    keys = unique_keys(morton_keys(_plane()[0, 0].nonzero().numpy()))
    with training.trainer() as trainer:
        losses = [trainer.step([keys]) for _ in range(training.steps)]
    undecided = math.log(4)  # of an occupied voxel, where the answer is one in four everywhere
    assert float(losses[-1].occupied) < undecided / 2


def test_the_rate_counts_fully_after_its_warm_up() -> None:
    training = Pcgcv1Training(steps=100, rate_warm_up=0.5)
    with training.trainer() as trainer:
        assert isinstance(trainer, Pcgcv1Trainer)
        rate_weights = []
        for trainer.done in (0, 25, 50, 99):
            rate_weights.append(trainer.rate_weight())
    assert rate_weights == pytest.approx([0.01, 0.1, 1, 1])
