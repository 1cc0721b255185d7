"""Training PCGCv1: the loss in closed form where it has one, and that a step lowers it."""

import math

import numpy as np
import pytest
import torch

from pcc_networks.gains import initialise_gains
from pcc_networks.pcgcv1.model import PCGCv1
from pcc_networks.pcgcv1.training import BETA, Pcgcv1Trainer, dense_cubes, rate_distortion_loss
from pcc_networks.sparse.voxels import morton_keys, unique_keys
from pcc_networks.training.settings import Pcgcv1Training
from pointkit.errors import InputError
from tests.support.learned_codecs import LMBDAS, TINY1

pytestmark = pytest.mark.usefixtures("one_thread")


def _cubes() -> torch.Tensor:
    cubes = torch.zeros(2, 1, 16, 16, 16)
    cubes[:, :, 5] = 1
    return cubes


def _planes() -> list[np.ndarray]:
    """The voxels of those cubes."""
    return [unique_keys(morton_keys(np.argwhere(cube[0].numpy()))) for cube in _cubes()]


def test_dense_cubes_hold_their_voxels() -> None:
    assert torch.equal(dense_cubes(_planes(), 16), _cubes())


def _noise() -> torch.Generator:
    return torch.Generator().manual_seed(0)


def test_an_undecided_network_costs_log_two_for_each_kind_of_voxel() -> None:
    torch.manual_seed(0)
    model = PCGCv1(TINY1)
    with torch.no_grad():
        model.g_s.conv_out.weight.zero_()
        model.g_s.conv_out.bias.zero_()
    loss = rate_distortion_loss(model, _cubes(), 1, 4.0, _noise())
    assert loss.empty.item() == pytest.approx(math.log(2))
    assert loss.occupied.item() == pytest.approx(math.log(2))
    expected = 4 * (BETA + 1) * math.log(2) + loss.bpp.item() + loss.hyper_bpp.item()
    assert loss.total.item() == pytest.approx(expected / 2, rel=1e-5)


def test_the_latents_bits_grow_with_its_gain() -> None:
    torch.manual_seed(0)
    model = PCGCv1(TINY1)
    initialise_gains(model, LMBDAS)
    np.testing.assert_allclose(model.log_gains.exp()[:, 0].detach(), [0.5, 1])
    with torch.no_grad():
        model.log_gains += 4
        coarse, fine = (
            rate_distortion_loss(model, _cubes(), rate, 1.0, _noise()).bpp for rate in (0, 1)
        )
    assert fine > coarse


def test_steps_lower_the_loss_and_reach_every_network() -> None:
    torch.manual_seed(0)
    model = PCGCv1(TINY1)
    training = Pcgcv1Training(
        lmbdas=LMBDAS, steps=10, cube_size=16, learning_rate=1e-2, final_learning_rate=1e-2
    )
    trainer = Pcgcv1Trainer(model, training)
    before = rate_distortion_loss(model, _cubes(), 1, 4.0, _noise()).total.item()
    start = {name: value.clone() for name, value in model.state_dict().items()}
    for _ in range(10):
        trainer.step(_planes())
    assert rate_distortion_loss(model, _cubes(), 1, 4.0, _noise()).total.item() < 0.8 * before
    changed = {n for n, value in model.state_dict().items() if not torch.equal(value, start[n])}
    parts = {name.split(".")[0] for name in changed}
    assert parts == {name.split(".")[0] for name in start}


def test_as_many_lambdas_as_rates() -> None:
    with pytest.raises(InputError, match="number of rates"):
        initialise_gains(PCGCv1(TINY1), (1.0,))
