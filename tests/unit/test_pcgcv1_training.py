"""Training PCGCv1: the loss in closed form where it has one, and that a step lowers it."""

import math
from collections.abc import Iterator

import numpy as np
import pytest
import torch

from puckbench.codecs.pcgcv1.model import PCGCv1, Shape
from puckbench.codecs.pcgcv1.training import BETA, loss_of, spread_gains, step
from puckbench.errors import InputError

TINY = Shape(side=16, widths=(4, 8, 16), latent=4, hyper=(16, 8), blocks=1, rates=2)
ALPHAS = (1.0, 4.0)


@pytest.fixture(scope="module", autouse=True)
def _one_thread() -> Iterator[None]:
    """Layers so small are slower with more."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def _cubes() -> torch.Tensor:
    cubes = torch.zeros(2, 1, 16, 16, 16)
    cubes[:, :, 5] = 1
    return cubes


def _noise() -> torch.Generator:
    return torch.Generator().manual_seed(0)


def test_an_undecided_network_costs_log_two_for_each_kind_of_voxel() -> None:
    torch.manual_seed(0)
    model = PCGCv1(TINY)
    with torch.no_grad():
        model.synthesis.last.weight.zero_()
        model.synthesis.last.bias.zero_()
    loss = loss_of(model, _cubes(), 1, 4.0, _noise())
    assert loss.empty.item() == pytest.approx(math.log(2))
    assert loss.occupied.item() == pytest.approx(math.log(2))
    expected = 4 * (BETA + 1) * math.log(2) + loss.bpp.item() + loss.hyper_bpp.item()
    assert loss.total.item() == pytest.approx(expected, rel=1e-5)


def test_the_latents_bits_grow_with_its_gain() -> None:
    torch.manual_seed(0)
    model = PCGCv1(TINY)
    spread_gains(model, ALPHAS)
    np.testing.assert_allclose(model.log_gains.exp()[:, 0].detach(), [0.5, 1])
    with torch.no_grad():
        model.log_gains += 4
        coarse, fine = (loss_of(model, _cubes(), rate, 1.0, _noise()).bpp for rate in (0, 1))
    assert fine > coarse


def test_steps_lower_the_loss_and_reach_every_network() -> None:
    torch.manual_seed(0)
    model = PCGCv1(TINY)
    optimiser = torch.optim.Adam(model.parameters(), lr=1e-2)
    noise = _noise()
    before = loss_of(model, _cubes(), 1, 4.0, _noise()).total.item()
    start = {name: value.clone() for name, value in model.state_dict().items()}
    for _ in range(10):
        step(model, optimiser, _cubes(), ALPHAS, noise)
    assert loss_of(model, _cubes(), 1, 4.0, _noise()).total.item() < 0.8 * before
    changed = {n for n, value in model.state_dict().items() if not torch.equal(value, start[n])}
    parts = {name.split(".")[0] for name in changed}
    assert parts == {name.split(".")[0] for name in start}


def test_as_many_alphas_as_rates() -> None:
    with pytest.raises(InputError, match="number of rates"):
        spread_gains(PCGCv1(TINY), (1.0,))
