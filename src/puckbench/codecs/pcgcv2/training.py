"""Training PCGCv2: its loss, one step, and a loop that can be stopped and taken up again.

The loss of a cloud at a rate is ``alpha * sum over 3 scales of the mean binary cross entropy, in
bits, of its candidate voxels + bits of the latent per point``, divided by the square root of alpha so that no rate outweighs the others where
they share weights. While training, rounding is uniform
noise and the true voxels are kept at each scale beside those that the network chose.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits

from puckbench.codecs.pcgcv2.model import SCALES, PCGCv2
from puckbench.codecs.sparse.convolution import site
from puckbench.codecs.sparse.crew import Crew
from puckbench.codecs.sparse.layers import largest
from puckbench.codecs.sparse.layout import blocks_layout, rows_layout
from puckbench.codecs.sparse.voxels import CHILDREN, Keys, Voxels, descended, keys_of_slots, pyramid
from puckbench.errors import InputError
from puckbench.files import written_whole


_FASTER = 5.0


class Loss(NamedTuple):
    """What a batch costs.

    entropies: mean bits of a candidate at strides 4, 2 and 1. bpp: bits of the latent per point.
    """

    total: Tensor
    entropies: tuple[Tensor, ...]
    bpp: Tensor


@dataclass(frozen=True)
class Training:
    """What a training run is: rates, steps, step size at the start and at the end, seed."""

    alphas: tuple[float, ...]
    steps: int
    rate_first: float = 1e-3
    rate_last: float = 2e-5
    seed: int = 1


def batch(clouds: Sequence[Keys]) -> Keys:
    """Clouds of voxels as one set in which none touches another."""
    bits = max(int(keys[-1]).bit_length() for keys in clouds)
    cell = 3 * (-(-bits // 3) + 1)  # twice the side, so that there is a gap
    if cell + (len(clouds) - 1).bit_length() > 60:
        raise InputError("the training clouds are too large for one batch")
    return np.concatenate([keys | i << cell for i, keys in enumerate(clouds)])


def spread_gains(model: PCGCv2, alphas: Sequence[float]) -> None:
    """Start the gains where fine rates have fine steps: by the square root of alpha."""
    highest = max(alphas)
    with torch.no_grad():
        for rate, alpha in enumerate(alphas):
            model.log_gains[rate] = 0.5 * math.log(alpha / highest)


def loss_of(
    model: PCGCv2, keys: Keys, rate: int, alpha: float, crew: Crew, noise: torch.Generator
) -> Loss:
    """The loss of voxels in Morton order at a rate."""
    device = model.log_gains.device
    sets, families = pyramid(keys, SCALES, crew)
    sites = [site(voxels.neighbours, rows_layout(), crew, device) for voxels in sets]
    latent = model.encoder(sites, families, torch.ones(len(keys), 1, 1, device=device))[:, 0]
    scaled = latent * model.gain(rate)
    noisy = scaled + torch.rand(scaled.shape, generator=noise).to(device) - 0.5
    bits = -model.bottleneck(rate).likelihood(noisy).log2().sum()
    entropies = _entropies(model, noisy / model.gain(rate), sets, crew)
    bpp = bits / len(keys)
    total = (alpha * torch.stack(entropies).sum() + bpp) / math.sqrt(alpha)
    return Loss(total, tuple(entropies), bpp)


def _entropies(model: PCGCv2, features: Tensor, sets: list[Voxels], crew: Crew) -> list[Tensor]:
    entropies, parents = [], sets[SCALES]
    for scale in range(SCALES):
        where = site(parents.neighbours, blocks_layout(), crew, features.device)
        children, logits = model.decoder.scale(scale)(features, where)
        truth = sets[SCALES - 1 - scale].keys
        occupied = _occupied(parents, truth)
        target = torch.from_numpy(occupied).to(logits)
        entropies.append(binary_cross_entropy_with_logits(logits.reshape(-1), target) / math.log(2))
        if scale + 1 < SCALES:
            chosen = largest(logits.detach().cpu().reshape(-1).numpy(), len(truth))
            kept = np.union1d(chosen, np.flatnonzero(occupied))
            features = children.flatten(0, 1)[torch.from_numpy(kept).to(features.device)]
            parents = descended(parents, kept, crew)
    return entropies


def _occupied(parents: Voxels, truth: Keys) -> NDArray[np.bool_]:
    """Which of all children of the parents are in a set of keys, ascending."""
    candidates = keys_of_slots(parents.keys, np.arange(CHILDREN * len(parents)))
    nearest = np.minimum(np.searchsorted(truth, candidates), len(truth) - 1)
    occupied: NDArray[np.bool_] = truth[nearest] == candidates
    return occupied


def _groups(model: PCGCv2) -> list[dict[str, Any]]:
    """Parameters of one rate alone are seldom trained, and take larger steps."""
    of_rates = [model.log_gains, *model.bottlenecks.parameters()]
    shared = [*model.encoder.parameters(), *model.decoder.parameters()]
    return [{"params": shared, "faster": 1.0}, {"params": of_rates, "faster": _FASTER}]


class Trainer:
    """A model in training: optimiser, schedule, randomness; everything that a resumed run needs."""

    def __init__(self, model: PCGCv2, training: Training, crew: Crew) -> None:
        if model.shape.rates != len(training.alphas):
            raise InputError("the model has another number of rates than the training")
        self.model = model
        self.training = training
        self.crew = crew
        self.done = 0
        self.optimiser = torch.optim.Adam(_groups(model))
        self.noise = torch.Generator().manual_seed(training.seed)

    def step(self, clouds: Sequence[Keys]) -> Loss:
        """One step on a batch, at the rate whose turn it is."""
        rate = int(torch.randint(len(self.training.alphas), (1,), generator=self.noise))
        for group in self.optimiser.param_groups:
            group["lr"] = self._step_size() * group["faster"]
        alpha = self.training.alphas[rate]
        self.optimiser.zero_grad(set_to_none=True)
        loss = loss_of(self.model, batch(clouds), rate, alpha, self.crew, self.noise)
        loss.total.backward()  # type: ignore[no-untyped-call]
        self.optimiser.step()
        self.done += 1
        return Loss(
            loss.total.detach(), tuple(e.detach() for e in loss.entropies), loss.bpp.detach()
        )

    def _step_size(self) -> float:
        """From the first to the last step size along half a cosine."""
        first, last = self.training.rate_first, self.training.rate_last
        turn = math.cos(math.pi * self.done / max(self.training.steps, 1))
        return last + (first - last) * (1 + turn) / 2

    def save(self, path: Path) -> None:
        """Write everything that a resumed run needs."""
        state = {
            "model": self.model.state_dict(),
            "optimiser": self.optimiser.state_dict(),
            "noise": self.noise.get_state(),
            "done": self.done,
            "training": asdict(self.training),
        }
        with written_whole(path) as temporary:
            torch.save(state, temporary)

    def resume(self, path: Path) -> None:
        """Go on where a saved run stopped; InputError when it was another training."""
        state: dict[str, Any] = torch.load(path, weights_only=True)
        state["training"]["alphas"] = tuple(state["training"]["alphas"])
        if state["training"] != asdict(self.training):
            raise InputError(f"{path}: the saved training has other settings")
        self.model.load_state_dict(state["model"])
        self.optimiser.load_state_dict(state["optimiser"])
        self.noise.set_state(state["noise"])
        self.done = int(state["done"])


def train(
    trainer: Trainer,
    clouds: Callable[[int], Sequence[Keys]],
    checkpoint: Path,
    every: int,
    report: Callable[[int, Loss], None],
) -> None:
    """Train to the end from where `checkpoint` stands, and save there every so many steps.

    clouds: the batch of a step. It must depend on the step's number alone, so that a resumed run
    sees what an unbroken one would have seen. report: told of each step when it is done.
    """
    if checkpoint.exists():
        trainer.resume(checkpoint)
    while trainer.done < trainer.training.steps:
        loss = trainer.step(clouds(trainer.done))
        report(trainer.done, loss)
        if trainer.done % every == 0 or trainer.done == trainer.training.steps:
            trainer.save(checkpoint)
