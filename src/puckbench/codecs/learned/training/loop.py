"""Training a network: steps along a schedule, in a loop that can be stopped and taken up again."""

from __future__ import annotations

import io
import json
import math
import pickle
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Generic, TypeVar

import torch
from torch import Tensor, nn

from puckbench.codecs.learned.sparse.voxels import Keys
from puckbench.codecs.learned.training.settings import Training
from puckbench.core.errors import InputError
from puckbench.core.files import write_bytes

M = TypeVar("M", bound=nn.Module)
L = TypeVar("L")
Row = Mapping[str, float]


class OtherTrainingError(InputError):
    """A checkpoint of another training than the one to go on with."""


class Trainer(ABC, Generic[M, L]):
    """A model in training: optimiser, schedule, randomness; everything that a resumed run needs.

    groups: parameters with how much larger steps than the schedule's they take (`faster`); all with
    the schedule's if none are given. identity: what else a checkpoint must have been made with,
    such as the data. curve: a row for each step done, for whoever fills it.
    """

    steepest: float | None = None
    """Longest gradient that a step follows; longer ones are shortened."""

    def __init__(
        self, model: M, training: Training, groups: Sequence[Mapping[str, Any]] = ()
    ) -> None:
        self.model = model
        self.training = training
        self.done = 0
        self.identity: dict[str, Any] = {}
        self.curve: list[dict[str, float]] = []
        whole = [{"params": list(model.parameters()), "faster": 1.0}]
        self.optimiser = torch.optim.Adam([dict(group) for group in groups or whole])
        self.noise = torch.Generator().manual_seed(training.seed)

    @abstractmethod
    def step(self, clouds: Sequence[Keys]) -> L:
        """One step on a batch of cubes; what it cost."""

    @abstractmethod
    def row(self, loss: L) -> dict[str, float]:
        """The cost of a step as a row of the curve, what is made smaller first."""

    def descend(self, loss: Tensor) -> None:
        """Change the weights along the gradient of a loss."""
        for group in self.optimiser.param_groups:
            group["lr"] = self._step_size() * group.get("faster", 1.0)
        self.optimiser.zero_grad(set_to_none=True)
        loss.backward()  # type: ignore[no-untyped-call]
        if self.steepest is not None:
            torch.nn.utils.clip_grad_norm_(self.model.parameters(), self.steepest)
        self.optimiser.step()
        self.done += 1

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
            "training": _plain(asdict(self.training)),
            "identity": _plain(self.identity),
            "curve": self.curve,
        }
        content = io.BytesIO()  # of a full disk PyTorch's own writer says nothing useful
        torch.save(state, content)
        write_bytes(path, content.getvalue())

    def resume(self, path: Path) -> None:
        """Go on where a saved run stopped; OtherTrainingError when it was another training.

        What a checkpoint says nothing of is not compared: older ones say less.
        """
        state = _read(path)
        for name, own in (("training", asdict(self.training)), ("identity", self.identity)):
            saved = _plain(state.get(name, {}))
            if any(saved.get(key, value) != value for key, value in _plain(own).items()):
                raise OtherTrainingError(f"{path}: the saved training has other settings or data")
        try:
            self.model.load_state_dict(state["model"])
            self.optimiser.load_state_dict(state["optimiser"])
            self.noise.set_state(state.get("noise", self.noise.get_state()))
            self.done = int(state["done"])
        except (KeyError, RuntimeError, TypeError, ValueError) as error:
            raise OtherTrainingError(f"{path}: not a checkpoint of this network") from error
        self.curve = state.get("curve", [])


def _plain(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Settings as JSON has them, so that lists and tuples are alike."""
    plain: dict[str, Any] = json.loads(json.dumps(settings))
    return plain


def _read(path: Path) -> dict[str, Any]:
    try:
        state: dict[str, Any] = torch.load(path, map_location="cpu", weights_only=True)
    except (OSError, RuntimeError, EOFError, pickle.UnpicklingError) as error:
        raise InputError(f"{path}: not a checkpoint of a training") from error
    if "settings" in state:  # where the octree coder's trainings once had them
        state["training"] = state["settings"]
    return state


def on_device(model: M) -> M:
    """The model where it is trained: on CUDA if there, else on the processor."""
    return model.to("cuda" if torch.cuda.is_available() else "cpu")


def train(
    trainer: Trainer[M, L],
    clouds: Callable[[int], Sequence[Keys]],
    checkpoint: Path,
    every: int,
    report: Callable[[int, L], None],
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
