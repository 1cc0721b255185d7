"""Sets of weights of the learned octree coder, in puckbench's own format of weights.

The tensors hold whole numbers, of the weights' units or of the activations', that half precision
keeps exactly.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from torch import Tensor

from puckbench.codecs.learned.octree_net.catalogue import NETWORK
from puckbench.codecs.learned.octree_net.fixed_point import MOST_WEIGHT, UNITS, WEIGHT_UNITS
from puckbench.codecs.learned.octree_net.model import OctreeNet, Shape
from puckbench.codecs.learned.weights_file import read_weights, write_weights
from puckbench.core.errors import InputError

_WIDEST, _DEEPEST = 256, 8


@dataclass(frozen=True)
class Weights:
    """A network, the digest that streams name it by, and its model card."""

    model: OctreeNet
    digest: bytes
    card: Mapping[str, Any]


def save_weights(path: Path, model: OctreeNet, card: Mapping[str, Any]) -> None:
    """Write the network's whole numbers; InputError when its sums might not be exact."""
    model.check()
    header = {
        "network": NETWORK.name,
        "shape": asdict(model.shape),
        "alphas": [],
        "card": dict(card),
    }
    state = {
        name: (value.detach() * _units(name)).round().clamp(-MOST_WEIGHT, MOST_WEIGHT)
        for name, value in model.state_dict().items()
    }
    write_weights(path, header, state)


def load_weights(path: Path) -> Weights:
    """Read a set; InputError when it is damaged, of another network, or too large to be exact."""
    found = read_weights(path)
    try:
        model = OctreeNet(_shape(found.header["shape"]))
        model.load_state_dict(real_state(found.state))
        card = found.header["card"]
    except (KeyError, TypeError, RuntimeError) as error:
        raise InputError(f"{path}: damaged weights") from error
    try:
        model.check()
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    return Weights(model.eval().requires_grad_(False), found.digest, card)


def real_state(whole: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Parameters from the whole numbers that a set keeps."""
    return {name: _real(name, value) for name, value in whole.items()}


def _units(name: str) -> int:
    return WEIGHT_UNITS if name.endswith("kernel") else UNITS


def _real(name: str, whole: Tensor) -> Tensor:
    return whole.round().clamp(-MOST_WEIGHT, MOST_WEIGHT) / _units(name)


def _shape(header: Mapping[str, int]) -> Shape:
    shape = Shape(**header)
    if not (0 < shape.width <= _WIDEST and 0 <= shape.before <= _DEEPEST):
        raise InputError("damaged weights (shape)")
    return shape
