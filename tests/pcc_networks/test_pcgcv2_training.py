from pathlib import Path

import numpy as np
import pytest
import torch

from pcc_networks.gains import initialise_gains
from pcc_networks.pcgcv2.model import PCGCv2
from pcc_networks.pcgcv2.training import Pcgcv2Loss, Pcgcv2Trainer, rate_distortion_loss
from pcc_networks.sparse.thread_pool import ThreadPool, thread_pool
from pcc_networks.sparse.voxels import morton_keys, morton_voxels
from pcc_networks.training.loop import CubeExamples, join_clouds, train
from pcc_networks.training.settings import Pcgcv2Training
from pointkit.errors import InputError
from tests.support.learned_codecs import LMBDAS, TINY2


def _cloud(step: int) -> list[np.ndarray]:
    rng = np.random.default_rng(step)
    sides = rng.integers(4, 12, 3)
    grid = np.stack(np.meshgrid(*map(np.arange, sides), indexing="ij"), axis=-1).reshape(-1, 3)
    shell = grid[((grid == 0) | (grid == sides - 1)).any(axis=1)]
    return [np.sort(morton_keys(shell + rng.integers(0, 4, 3)))]


def _trainer(pool: ThreadPool, steps: int = 4) -> Pcgcv2Trainer:
    torch.manual_seed(0)
    model = PCGCv2(TINY2)
    initialise_gains(model, LMBDAS)
    return Pcgcv2Trainer(
        model, Pcgcv2Training(lmbdas=LMBDAS, steps=steps, learning_rate=5e-3), pool
    )


def _number(value: torch.Tensor) -> float:
    return float(value.detach())


def test_clouds_of_a_batch_do_not_touch() -> None:
    clouds = [_cloud(0)[0], _cloud(1)[0], _cloud(2)[0]]
    keys = join_clouds(clouds)
    assert np.array_equal(np.unique(keys), keys)
    owner = np.repeat(np.arange(3), [len(cloud) for cloud in clouds])
    voxels = morton_voxels(keys)
    for first, other in ((0, 1), (0, 2), (1, 2)):
        apart = np.abs(voxels[owner == first][:, None] - voxels[owner == other][None]).max(axis=2)
        assert apart.min() > 8


def test_the_loss_is_the_weighted_sum_of_its_parts() -> None:
    with thread_pool(1) as pool:
        trainer = _trainer(pool)
        loss = rate_distortion_loss(trainer.model, _cloud(0)[0], 1, 4.0, pool, torch.Generator())
    entropy = np.dot(list(map(_number, loss.cross_entropies)), [12 / 7, 6 / 7, 3 / 7])
    expected = 4.0 * entropy + _number(loss.bpp)
    assert _number(loss.total) == pytest.approx(expected / 2, rel=1e-5)


def test_an_even_guess_costs_one_bit_a_candidate() -> None:
    with thread_pool(1) as pool:
        model = _trainer(pool).model
        with torch.no_grad():
            for scale in range(3):
                model.g_s.scale(scale).conv_cls.kernel.zero_()
        loss = rate_distortion_loss(model, _cloud(0)[0], 0, 1.0, pool, torch.Generator())
    assert [_number(entropy) for entropy in loss.cross_entropies] == pytest.approx([1, 1, 1])


def test_training_lowers_the_loss() -> None:
    with thread_pool(2) as pool:
        trainer = _trainer(pool, steps=30)
        losses = [float(sum(trainer.step(_cloud(0)).cross_entropies)) for _ in range(30)]
    assert np.mean(losses[-5:]) < 0.8 * np.mean(losses[:5])


def test_every_parameter_of_the_chosen_rate_has_a_gradient() -> None:
    with thread_pool(1) as pool:
        model = _trainer(pool).model
        loss = rate_distortion_loss(model, _cloud(0)[0], 1, 4.0, pool, torch.Generator())
        loss.total.backward()
    lacking = [name for name, value in model.named_parameters() if value.grad is None]
    assert lacking
    assert all(name.startswith("entropy_bottlenecks.0.") for name in lacking)


def _ignore(step: int, loss: Pcgcv2Loss) -> None:
    pass


def test_a_resumed_training_ends_as_an_unbroken_one(tmp_path: Path) -> None:
    with thread_pool(2) as pool:
        whole = _trainer(pool)
        train(whole, _cloud, tmp_path / "whole.pt", 10, _ignore)
        broken = _trainer(pool)
        for step in range(2):
            broken.step(_cloud(step))
        broken.save(tmp_path / "broken.pt")
        resumed = _trainer(pool)
        train(resumed, _cloud, tmp_path / "broken.pt", 1, _ignore)
    assert resumed.done == whole.done == 4
    for name, value in whole.model.state_dict().items():
        assert torch.equal(resumed.model.state_dict()[name], value), name


def test_another_trainings_checkpoint_is_refused(tmp_path: Path) -> None:
    with thread_pool(1) as pool:
        _trainer(pool, steps=4).save(tmp_path / "a.pt")
        with pytest.raises(InputError, match="other settings"):
            _trainer(pool, steps=5).resume(tmp_path / "a.pt")


def _plane() -> np.ndarray:
    grid = np.stack(np.meshgrid(np.arange(60), np.arange(60), indexing="ij"), axis=-1)
    return np.column_stack([grid.reshape(-1, 2), grid.reshape(-1, 2).sum(axis=1) // 2])


def test_a_batch_depends_on_its_number_and_the_seed_alone() -> None:
    examples = [
        CubeExamples([_plane()], cube_size=32, batch_size=3, seed=seed) for seed in (1, 1, 2)
    ]
    batches = [made.batch(7) for made in examples]
    assert all(np.array_equal(a, b) for a, b in zip(batches[0], batches[1], strict=True))
    assert not np.array_equal(batches[0][0], batches[2][0])
    assert not np.array_equal(examples[0].batch(8)[0], batches[0][0])
    assert all(morton_voxels(keys).max() < 32 for keys in batches[0])


def test_clouds_too_sparse_to_learn_from_are_refused() -> None:
    with pytest.raises(
        InputError, match="no cube of 8 voxels' side holds 200 voxels: give denser clouds"
    ):
        CubeExamples([_plane()], cube_size=8).batch(0)


def test_a_checkpoint_that_says_less_is_taken_up(tmp_path: Path) -> None:
    """Settings that it does not name, random numbers and the curve are those of the new run."""
    training = Pcgcv2Training(lmbdas=LMBDAS, steps=4, channels=TINY2.channels)
    with thread_pool(1) as pool:
        old = Pcgcv2Trainer(PCGCv2(TINY2), training, pool)
        old.done = 3
        old.save(tmp_path / "a.pt")
        state = torch.load(tmp_path / "a.pt", weights_only=True)
        kept = {name: state[name] for name in ("model", "optimiser", "done")}
        settings = {name: training.model_dump()[name] for name in ("steps", "seed")}
        torch.save({**kept, "training": settings}, tmp_path / "b.pt")
        new = Pcgcv2Trainer(PCGCv2(TINY2), training, pool)
        new.resume(tmp_path / "b.pt")
    assert new.done == 3
    for name, value in old.model.state_dict().items():
        assert torch.equal(new.model.state_dict()[name], value)
