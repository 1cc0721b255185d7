from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from torch import Tensor

from pcc_networks.catalogue import OCTREE_NET, weights_path
from pcc_networks.octree_net.model import MAX_WEIGHT, UNITS, WEIGHT_UNITS, OctreeNet, OctreeNetShape
from pcc_networks.weights_file import read_weights, write_weights
from pointkit.errors import InputError, naming
from pointkit.models import parsed


@dataclass(frozen=True)
class OctreeNetWeights:
    """Trained weights of the sparse octree net, ready for `encode` and `decode`.

    Attributes
    ----------
    model
        The network with its parameters.
    digest
        8 bytes by which streams name the weights.
    card
        Model card, such as the training data.
    """

    model: OctreeNet
    digest: bytes
    card: Mapping[str, Any]


def save_weights(path: Path, model: OctreeNet, card: Mapping[str, Any]) -> None:
    """Write the weights of a network, as integers, to a safetensors file.

    Parameters
    ----------
    path
        File to write; an existing file is replaced.
    model
        The trained network.
    card
        Model card, such as the training data, which is stored in the header of the file as JSON.

    Raises
    ------
    InputError
        If the weights are so large that sums might be inexact.
    """
    model.check_exact()
    header_fields = {
        "network": OCTREE_NET.name,
        "shape": model.shape.model_dump(),
        "lmbdas": (),
        "card": dict(card),
    }
    state = {
        name: (value.detach() * _units(name)).round().clamp(-MAX_WEIGHT, MAX_WEIGHT)
        for name, value in model.state_dict().items()
    }
    write_weights(path, header_fields, state)


def load_weights(where: str | Path) -> OctreeNetWeights:
    """Read trained weights of the sparse octree net.

    Parameters
    ----------
    where
        Name of weights that come with the package (``sparse_octree_net_rooms``), or the path of a
        file that `save_weights` wrote.

    Returns
    -------
    OctreeNetWeights
        The network with its parameters, for `encode` and `decode`.

    Raises
    ------
    InputError
        If the file is damaged or of another network, or if its weights are too large for exact
        sums.
    """
    path = weights_path(where)
    contents = read_weights(path)
    try:
        model = OctreeNet(parsed(OctreeNetShape, contents.header.shape, f"{path}: shape"))
        model.load_state_dict(parameters(contents.state))
    except RuntimeError as error:
        raise InputError(f"{path}: damaged weights") from error
    with naming(path):
        model.check_exact()
    return OctreeNetWeights(
        model.eval().requires_grad_(False), contents.digest, contents.header.card
    )


def parameters(integers: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Convert the integers of a file of weights to parameters of an `OctreeNet`."""
    return {
        name: value.round().clamp(-MAX_WEIGHT, MAX_WEIGHT) / _units(name)
        for name, value in integers.items()
    }


def _units(name: str) -> int:
    return WEIGHT_UNITS if name.endswith("kernel") else UNITS
