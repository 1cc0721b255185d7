from pathlib import Path

import numpy as np
import pytest
import torch

from pcc_networks.octree_net.model import (
    MAX_SUM,
    FixedPointLayer,
    OctreeNet,
    OctreeNetShape,
    largest_sum,
    quantised,
    quantised_weight,
)
from pcc_networks.octree_net.training import (
    OctreeExamples,
    OctreeNetTrainer,
    bits_per_level,
    limit_weights,
)
from pcc_networks.sparse.thread_pool import ThreadPool, thread_pool
from pcc_networks.sparse.voxels import morton_keys, morton_voxels
from pcc_networks.training.loop import random_symmetry, train
from pcc_networks.training.settings import OctreeNetTraining
from pointkit.errors import InputError
from pointkit.models import parsed


def _room(points: int = 3000) -> np.ndarray:
    """Two walls and a floor, with noise."""
    rng = np.random.default_rng(0)
    points = rng.random((points, 3)) * 60
    points[np.arange(len(points)), rng.integers(0, 3, len(points))] = 7.0
    return points + rng.normal(scale=0.4, size=points.shape)


def _examples(seed: int = 1) -> OctreeExamples:
    return OctreeExamples([_room()], cube_size=16, batch_size=2, min_voxels=20, seed=seed)


def _trainer(pool: ThreadPool, steps: int = 4) -> OctreeNetTrainer:
    torch.manual_seed(0)
    return OctreeNetTrainer(
        OctreeNet(OctreeNetShape(channels=8)), OctreeNetTraining(steps=steps, cube_size=16), pool
    )


def test_training_lowers_the_bits() -> None:
    with thread_pool(2) as pool:
        trainer = _trainer(pool, steps=40)
        bits = [trainer.step(_examples().batch(0)) for _ in range(40)]
    assert np.mean(bits[-5:]) < 0.9 * np.mean(bits[:5])


def test_equal_logits_cost_eight_bits_a_voxel_of_each_level() -> None:
    model = OctreeNet(OctreeNetShape(channels=8))
    with torch.no_grad():
        for head in (*model.first_heads, *model.second_heads):
            head.logits.kernel.zero_()
            head.logits.bias.zero_()
    keys = np.unique(morton_keys(_room().clip(0, 63).astype(np.int64)))
    with thread_pool(1) as pool, torch.no_grad():
        bits = [float(level) for level in bits_per_level(model, keys, 3, pool)]
    assert bits == pytest.approx([8 * len(np.unique(keys >> 3 * depth)) for depth in (3, 2, 1)])


def test_every_parameter_has_a_gradient() -> None:
    with thread_pool(1) as pool:
        trainer = _trainer(pool)
        trainer.step(_examples().batch(0))
    assert all(value.grad is not None for value in trainer.model.parameters())


def test_a_resumed_training_ends_as_an_unbroken_one(tmp_path: Path) -> None:
    batch = _examples().batch
    with thread_pool(2) as pool:
        whole = _trainer(pool)
        train(whole, batch, tmp_path / "whole.pt", 10, lambda step, bits: None)
        broken = _trainer(pool)
        for step in range(2):
            broken.step(batch(step))
        broken.save(tmp_path / "broken.pt")
        resumed = _trainer(pool)
        train(resumed, batch, tmp_path / "broken.pt", 1, lambda step, bits: None)
        with pytest.raises(InputError, match="other settings"):
            _trainer(pool, steps=5).resume(tmp_path / "broken.pt")
    assert resumed.done == whole.done == 4
    for name, value in whole.model.state_dict().items():
        assert torch.equal(resumed.model.state_dict()[name], value), name


def test_limited_weights_keep_sums_exact() -> None:
    model = OctreeNet(OctreeNetShape(channels=8))
    with torch.no_grad():
        for layer in model.modules():
            if isinstance(layer, FixedPointLayer):
                layer.kernel.fill_(3.0)
    limit_weights(model)
    model.check_exact()
    kernel, bias = quantised_weight(model.group_convolutions[0].kernel), quantised(torch.zeros(8))
    assert 0.8 * MAX_SUM < largest_sum(kernel, bias) < MAX_SUM


def test_a_batch_depends_on_its_number_and_the_seed_alone() -> None:
    first, again, other = (_examples(seed).batch(3) for seed in (1, 1, 2))
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))
    assert not np.array_equal(first[0], other[0])
    assert all(morton_voxels(keys).max() < 16 for keys in first)


def test_clouds_too_sparse_to_learn_from_are_refused() -> None:
    with pytest.raises(
        InputError, match="no cube of 8 voxels' side holds 5000 voxels: give denser clouds"
    ):
        OctreeExamples([_room()], cube_size=8, min_voxels=5000).batch(0)


@pytest.mark.parametrize(("upright", "symmetries"), [(False, 48), (True, 8)])
def test_cubes_are_turned_into_their_symmetries(upright: bool, symmetries: int) -> None:
    rng, voxel = np.random.default_rng(0), np.array([[0, 1, 2]])
    result = {tuple(random_symmetry(voxel, 8, rng, upright)[0].tolist()) for _ in range(1000)}
    assert len(result) == symmetries
    assert not upright or {z for _, _, z in result} == {2}


def test_other_numbers_of_symmetries_are_refused() -> None:
    assert OctreeNetTraining(symmetries=8).examples([_room()]).upright
    with pytest.raises(InputError, match=r"symmetries is 7, but must be 8 or 48"):
        parsed(OctreeNetTraining, {"symmetries": 7}, "training")
