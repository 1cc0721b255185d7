"""PCGCv1's first weights: what they are for, seen on another example than they were made with."""

import math

import pytest
import torch
from torch import nn

from puckbench.codecs.learned.pcgcv1.initialisation import level, sphere
from puckbench.codecs.learned.pcgcv1.model import PCGCv1, Shape
from puckbench.codecs.learned.pcgcv1.training import Trainer
from puckbench.codecs.learned.pcgcv1.training_settings import Training
from puckbench.codecs.learned.sparse.voxels import unique_keys, morton_keys

pytestmark = pytest.mark.usefixtures("one_thread")
SIDE = 16


def _spreads(model: nn.Module, cubes: torch.Tensor) -> dict[str, float]:
    """Standard deviation of what each convolution answers."""
    found: dict[str, float] = {}

    def note(name: str) -> object:
        return lambda _layer, _inputs, answers: found.update({name: float(answers.std())})

    for name, layer in model.named_modules():
        if isinstance(layer, (nn.Conv3d, nn.ConvTranspose3d)):
            layer.register_forward_hook(note(name))
    with torch.no_grad():
        latent = model.analysis(cubes)
        model.hyper_decoder(model.hyper_encoder(latent))
        model.synthesis(latent)
    return found


def _plane() -> torch.Tensor:
    cubes = torch.zeros(1, 1, SIDE, SIDE, SIDE)
    cubes[:, :, 5] = 1
    return cubes


def test_no_layers_answers_vanish_or_grow() -> None:
    torch.manual_seed(0)
    before, after = PCGCv1(Shape(side=SIDE)), PCGCv1(Shape(side=SIDE))
    level(after, SIDE)
    rounding = math.sqrt(1 / 12)
    assert _spreads(before, _plane())["analysis.last"] < rounding / 2
    spreads = _spreads(after, _plane())
    assert 0.05 < min(spreads.values()) < max(spreads.values()) < 20
    assert spreads["analysis.last"] > 5 * rounding


def test_a_sphere_is_answered_as_was_asked_for() -> None:
    torch.manual_seed(0)
    model = PCGCv1(Shape(side=SIDE))
    level(model, SIDE)
    spreads = _spreads(model, sphere(SIDE))
    assert spreads["analysis.last"] == pytest.approx(4, rel=1e-3)
    assert spreads["synthesis.first"] == pytest.approx(1, rel=1e-3)
    assert model.synthesis.last.bias.item() == pytest.approx(-math.log(3))


def test_a_spheres_shell_is_one_voxel_thick() -> None:
    shell = sphere(32)[0, 0]
    assert 4 * math.pi * 12.8**2 == pytest.approx(float(shell.sum()), rel=0.1)
    assert shell[0].sum() == 0


def test_the_networks_learn_where_an_empty_answer_is_the_first_way_down() -> None:
    """The whole of it: first weights, and bits that count little at first."""
    training = Training(
        steps=60, side=SIDE, cubes=1, alphas=(2.0, 10.0), widths=(4, 8, 16), rate_first=3e-3
    )
    keys = unique_keys(morton_keys(_plane()[0, 0].nonzero().numpy()))
    with training.trainer() as trainer:
        losses = [trainer.step([keys]) for _ in range(training.steps)]
    undecided = math.log(4)  # of an occupied voxel, where the answer is one in four everywhere
    assert float(losses[-1].occupied) < undecided / 2


def test_bits_count_fully_after_the_eased_share() -> None:
    training = Training(steps=100, eased=0.5)
    with training.trainer() as trainer:
        assert isinstance(trainer, Trainer)
        prices = []
        for trainer.done in (0, 25, 50, 99):
            prices.append(trainer.price())
    assert prices == pytest.approx([0.01, 0.1, 1, 1])
