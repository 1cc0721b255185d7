"""Files of trained weights: safetensors, with the network's shape and a model card as metadata."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pointkit.errors import InputError, among
from pointkit.files import read_bytes, refuse_special, write_bytes
from pointkit.models import Model

if TYPE_CHECKING:
    from torch import Tensor

SUFFIX = ".safetensors"
NETWORK = "lidar_segmentation"
"""Name of the architecture in the header of a file."""
_KEY = "puckbench"
_DIGEST_DIGITS = 16
_MAX_BYTES = 2**24


class Header(Model):
    """What a file of weights says about itself."""

    network: str
    shape: dict[str, Any]
    card: dict[str, Any]
    sha256: str


@dataclass(frozen=True)
class WeightsFile:
    """The contents of a file of weights.

    Parameters
    ----------
    header
        Shape of the network and model card.
    arrays
        Parameters by name, half precision.
    digest
        16 hexadecimal digits, the first of the SHA-256 of the file.
    """

    header: Header
    arrays: dict[str, NDArray[np.float16]]
    digest: str


def shipped() -> dict[str, Path]:
    """Return the files of weights that come with the package, as a mapping from names to paths."""
    folder = Path(str(files("lidar_segmentation").joinpath("weights")))
    return {path.stem: path for path in sorted(folder.glob(f"*{SUFFIX}"))}


def weights_path(where: str | Path) -> Path:
    """Return the path of shipped weights by their name, or the path of an existing file.

    Raises InputError if there is neither.
    """
    names = shipped()
    if str(where) in names:
        return names[str(where)]
    path = Path(where)
    if not path.is_file():
        raise InputError(f"{path}: no such file of weights, nor shipped{among(str(where), names)}")
    return path


def write_weights(
    path: Path, shape: Model, state: Mapping[str, Tensor], card: Mapping[str, Any]
) -> None:
    """Write a file of weights, rounded to half precision.

    Parameters
    ----------
    path
        File to write.
    shape
        Sizes of the network.
    state
        Parameters by name.
    card
        Model card, such as the training data, as values that JSON can store.
    """
    from safetensors.numpy import save

    arrays = {name: value.detach().cpu().half().numpy() for name, value in state.items()}
    header = {
        "network": NETWORK,
        "shape": shape.model_dump(mode="json"),
        "card": dict(card),
        "sha256": _check_sum(arrays),
    }
    metadata = {_KEY: json.dumps(header, sort_keys=True, allow_nan=False)}
    write_bytes(path, save(arrays, metadata=metadata))


def read_weights(path: Path) -> WeightsFile:
    """Read a file of weights.

    Raises
    ------
    InputError
        The file is damaged, of another network, or has parameters that are not finite.
    """
    from safetensors import SafetensorError, safe_open
    from safetensors.numpy import load

    refuse_special(path)
    data = read_bytes(path)
    if len(data) > _MAX_BYTES:
        raise InputError(f"{path}: damaged weights (more than {_MAX_BYTES} bytes)")
    try:
        arrays = load(data)
        with safe_open(path, framework="np") as file:
            text = (file.metadata() or {})[_KEY]
        network = json.loads(text)["network"]
        header = None if network != NETWORK else Header.model_validate_json(text)
    except (SafetensorError, LookupError, TypeError, ValueError) as error:
        raise InputError(f"{path}: damaged weights, or not a set of weights") from error
    if header is None:
        raise InputError(f"{path}: weights of another network ({network})")
    if _check_sum(arrays) != header.sha256:
        raise InputError(f"{path}: damaged weights (check sum)")
    if not all(each.dtype == np.float16 and np.isfinite(each).all() for each in arrays.values()):
        raise InputError(f"{path}: damaged weights (not finite, or not in half precision)")
    return WeightsFile(header, arrays, hashlib.sha256(data).hexdigest()[:_DIGEST_DIGITS])


def _check_sum(arrays: Mapping[str, NDArray[Any]]) -> str:
    digest = hashlib.sha256()
    for name in sorted(arrays):
        digest.update(f"{name} {arrays[name].shape}".encode())
        digest.update(np.ascontiguousarray(arrays[name]).tobytes())
    return digest.hexdigest()
