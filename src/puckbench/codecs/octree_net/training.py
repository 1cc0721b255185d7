"""Training: bits of a batch's symbols as the loss, and a loop that can be taken up again.

The network computes in fixed point while it is trained too, bit for bit as the codec will (rounding
passes gradients unchanged), so that nothing is lost when its weights become whole numbers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor
from torch.nn.functional import cross_entropy

from puckbench.codecs.octree_net.fixed import MOST_ACTIVATION, MOST_SUM, WEIGHT_UNITS
from puckbench.codecs.octree_net.model import Layer, OctreeNet, index
from puckbench.codecs.octree_net.symbols import Symbols, groups_of, symbols_of
from puckbench.codecs.pcgcv2.training import batch
from puckbench.codecs.sparse.convolution import Site, site
from puckbench.codecs.sparse.crew import Crew
from puckbench.codecs.sparse.layout import rows_layout
from puckbench.codecs.sparse.voxels import Keys, pyramid
from puckbench.errors import InputError
from puckbench.files import written_whole

_LARGEST_ROW = 0.9 * MOST_SUM / (MOST_ACTIVATION * WEIGHT_UNITS)
"""Sum of a layer's weights onto one feature, at most: exact sums, and something to spare."""
_STEEPEST = 1.0


@dataclass(frozen=True)
class Training:
    """What a training run is: steps, step size at the start and at the end, cubes' side."""

    steps: int
    side: int = 128
    rate_first: float = 3e-3
    rate_last: float = 2e-5
    seed: int = 1


def bits_per_level(model: OctreeNet, keys: Keys, levels: int, crew: Crew) -> list[Tensor]:
    """Bits of all symbols of each of the `levels` above voxels in Morton order, coarse first."""
    device = model.top.device
    sets, families = pyramid(keys, levels, crew)
    features = model.start(len(sets[-1]))
    bits = []
    for depth in range(levels, 0, -1):
        where = site(sets[depth].neighbours, rows_layout(), crew, device)
        features = model.before_groups(features, where)
        symbols = symbols_of(sets[depth - 1].keys)
        of_level, features = _bits_of_level(model, features, sets[depth].keys, symbols, where)
        bits.append(of_level)
        if depth > 1:
            slots = torch.from_numpy(families[depth - 1].slots).to(device)
            features = model.below(features, slots)
    return bits


def _bits_of_level(
    model: OctreeNet, features: Tensor, keys: Keys, symbols: tuple[Symbols, Symbols], where: Site
) -> tuple[Tensor, Tensor]:
    """Bits of a level's symbols, and features that know them."""
    bits = []
    for group, rows in enumerate(groups_of(keys)):
        if len(rows):
            at = index(rows, features)
            own = model.of_group(group, features, at, where)
            first, second = (index(symbol[rows], features) for symbol in symbols)
            bits.append(_bits(model.first_heads[group](own), first))
            own = model.with_first(own, first)
            bits.append(_bits(model.second_heads[group](own), second))
            features = features.index_copy(0, at, model.with_second(own, second))
    return torch.stack(bits).sum(), features


def _bits(logits: Tensor, symbols: Tensor) -> Tensor:
    """Bits of symbols (n,) by logits (n, 16) to the base 2."""
    nats = cross_entropy(logits * math.log(2), symbols, reduction="sum")
    return nats / math.log(2)


class Trainer:
    """A network in training: optimiser and schedule; everything that a resumed run needs."""

    def __init__(self, model: OctreeNet, training: Training, crew: Crew) -> None:
        self.model, self.training, self.crew = model, training, crew
        self.done = 0
        self.optimiser = torch.optim.Adam(model.parameters(), lr=training.rate_first)

    def step(self, clouds: Sequence[Keys]) -> float:
        """One step on a batch of cubes; bits per voxel."""
        for group in self.optimiser.param_groups:
            group["lr"] = self._step_size()
        keys = batch(clouds)
        levels = (self.training.side - 1).bit_length()
        self.optimiser.zero_grad(set_to_none=True)
        loss = torch.stack(bits_per_level(self.model, keys, levels, self.crew)).sum() / len(keys)
        loss.backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(self.model.parameters(), _STEEPEST)
        self.optimiser.step()
        limit(self.model)
        self.done += 1
        return float(loss.detach())

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
            "done": self.done,
            "settings": self._settings(),
        }
        with written_whole(path) as temporary:
            torch.save(state, temporary)

    def resume(self, path: Path) -> None:
        """Go on where a saved run stopped; InputError when it was another training."""
        state: dict[str, Any] = torch.load(path, weights_only=True)
        if state["settings"] != self._settings():
            raise InputError(f"{path}: the saved training has other settings")
        self.model.load_state_dict(state["model"])
        self.optimiser.load_state_dict(state["optimiser"])
        self.done = int(state["done"])

    def _settings(self) -> dict[str, Any]:
        return {**asdict(self.training), **asdict(self.model.shape)}


def limit(model: OctreeNet) -> None:
    """Shrink the weights onto a feature where their sums might cease to be exact."""
    with torch.no_grad():
        for layer in model.modules():
            if isinstance(layer, Layer):
                rows = layer.kernel.abs().sum(dim=(0, 1))
                layer.kernel.mul_((_LARGEST_ROW / rows).clamp_max(1))


def train(
    trainer: Trainer,
    clouds: Callable[[int], Sequence[Keys]],
    checkpoint: Path,
    every: int,
    report: Callable[[int, float], None],
) -> None:
    """Train to the end from where `checkpoint` stands, and save there every so many steps.

    clouds: the batch of a step, which must depend on the step's number alone. report: told of each
    step and its bits per voxel.
    """
    if checkpoint.exists():
        trainer.resume(checkpoint)
    while trainer.done < trainer.training.steps:
        bits = trainer.step(clouds(trainer.done))
        report(trainer.done, bits)
        if trainer.done % every == 0 or trainer.done == trainer.training.steps:
            trainer.save(checkpoint)
