"""Reading and writing of trained weights, as safetensors files with parameters and a model card.

Parameters are stored in half precision. Files of networks with an entropy bottleneck also contain
its integer frequency tables. These tables are computed when a file is written, since floating-point
arithmetic differs between machines.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, TypeVar

from pointkit.errors import InputError

if TYPE_CHECKING:
    import torch
    from torch import nn
import hashlib
import json
import pickle
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, Generic

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load, save
from torch import Tensor

from pcc_networks.catalogue import HEADER_KEY, SUFFIX, NetworkType, WeightsHeader, header_of
from pcc_networks.entropy_bottleneck import FrequencyTable, frequency_tables
from pcc_networks.gains import MultiRateNetwork
from pointkit.files import read_bytes, write_bytes
from pointkit.models import parsed

M = TypeVar("M", bound="nn.Module")
DeviceName = Literal["cpu", "cuda"]


def why_not(name: DeviceName) -> str:
    """Return the reason why networks cannot run on a device, or an empty string if they can."""
    if name == "cpu":
        return ""
    import torch

    if torch.cuda.is_available():
        return ""
    return f"device {name}: PyTorch finds no CUDA device here"


def placed(model: M, name: DeviceName) -> M:
    """Move a model to a device, and return it.

    CUDA is set to full single precision, so that sums that are exact on a CPU stay exact.

    Raises
    ------
    InputError
        If the device does not exist.
    """
    import torch

    if reason := why_not(name):
        raise InputError(reason)
    torch.backends.cuda.matmul.allow_tf32 = False
    torch.backends.cudnn.allow_tf32 = False
    return model.to(name)


def device_of(model: nn.Module) -> torch.device:
    """Return the device of a model's parameters."""
    return next(model.parameters()).device


DIGEST_BYTES = 8
_LENGTH_BYTES = 8
"""Bytes of the JSON header's length at the start of a safetensors file."""
_TABLES = ("frequency_tables.lowest", "frequency_tables.length", "frequency_tables.frequencies")
_MAX_MAGNITUDE = 2**16
N = TypeVar("N", bound=MultiRateNetwork)
Tables = tuple[tuple[FrequencyTable, ...], ...]
"""Frequency tables by rate and channel."""
Arrays = Mapping[str, NDArray[Any]]


@dataclass(frozen=True)
class WeightsFile:
    """The contents of a file of weights."""

    header: WeightsHeader
    state: dict[str, Tensor]  # parameters by name, float32
    integers: dict[str, NDArray[np.int32]]  # integer tensors by name
    digest: bytes  # 8 bytes by which streams name the set


def digest_of(data: bytes) -> bytes:
    """Return the 8 bytes by which streams name weights, from all bytes of the file."""
    return hashlib.sha256(data).digest()[:DIGEST_BYTES]


OTHER_RESULT = (
    "the stream decodes to other points than were coded: this machine does not compute as the "
    "encoder's did (or the stream is damaged)"
)
"""Message for a stream whose check sum is not that of the decoded values."""


def check_digest(weights: bytes, stream: bytes) -> None:
    """Raise InputError if the digest in a stream differs from the digest of the weights."""
    if stream != weights:
        raise InputError(
            f"the stream was made with other weights ({stream.hex()}, here {weights.hex()})"
        )


def write_weights(
    path: Path,
    header_fields: Mapping[str, Any],
    state: Mapping[str, Tensor],
    integers: Mapping[str, NDArray[np.int32]] | None = None,
) -> None:
    """Write a file of weights.

    Parameters
    ----------
    path
        File to write.
    header_fields
        Fields of the `WeightsHeader`, except the check sum.
    state
        Parameters by name; they are rounded to half precision.
    integers
        Integer arrays by name, such as frequency tables.
    """
    tensors: dict[str, NDArray[Any]] = {
        name: value.detach().cpu().half().contiguous().numpy() for name, value in state.items()
    }
    tensors |= {
        name: np.ascontiguousarray(value, "<i4") for name, value in (integers or {}).items()
    }
    header = {**header_fields, "sha256": _checksum(save(tensors))}
    # one entry, since safetensors writes several in arbitrary order
    metadata = {HEADER_KEY: json.dumps(header, sort_keys=True, allow_nan=False)}
    write_bytes(path, save(tensors, metadata=metadata))


def read_weights(path: Path) -> WeightsFile:
    """Read a file of weights.

    Raises
    ------
    InputError
        If the file is damaged, or has parameters that are not finite.
    """
    header, data = header_of(path), read_bytes(path)
    try:
        arrays = load(data)
        is_intact = _checksum(data) == header.sha256
        digest = bytes.fromhex(header.digest or "") or digest_of(data)
    except (SafetensorError, KeyError, ValueError) as error:
        raise InputError(f"{path}: damaged weights") from error
    if not is_intact or len(digest) != DIGEST_BYTES:
        raise InputError(f"{path}: damaged weights (check sum)")
    integers = {name: array for name, array in arrays.items() if array.dtype == np.int32}
    floats = {name: array for name, array in arrays.items() if name not in integers}
    if not all(_is_parameter(array) for array in floats.values()):
        raise InputError(f"{path}: damaged weights (not finite, or not in half precision)")
    state = {name: torch.from_numpy(a.astype(np.float32)) for name, a in floats.items()}
    return WeightsFile(header, state, integers, digest)


def _checksum(data: bytes) -> str:
    start = _LENGTH_BYTES + int.from_bytes(data[:_LENGTH_BYTES], "little")
    return hashlib.sha256(memoryview(data)[start:]).hexdigest()


def _is_parameter(array: NDArray[Any]) -> bool:
    return array.dtype == np.float16 and bool(np.isfinite(array).all())


@dataclass(frozen=True)
class MultiRateWeights(Generic[N]):
    """Trained weights of a network for one or several rates, with all that coding needs."""

    model: N
    lmbdas: tuple[float, ...]  # Lagrangian weights of the rates, lowest bitrate first
    tables: Tables  # frequency tables of the entropy bottleneck of each rate
    digest: bytes  # 8 bytes by which streams name the weights and tables
    card: Mapping[str, Any]  # model card


def check_rate(weights: MultiRateWeights[Any], rate: int) -> None:
    """Raise InputError if the weights have no rate with this index."""
    if not 0 <= rate < len(weights.lmbdas):
        raise InputError(f"rate {rate}: the weights have {len(weights.lmbdas)} rates, from 0 on")


def check_made_with(weights: MultiRateWeights[Any], digest: bytes, rate: int) -> None:
    """Raise InputError if a stream was made with other weights, or its rate does not exist."""
    check_digest(weights.digest, digest)
    if rate >= len(weights.lmbdas):
        raise InputError("the stream is damaged (its rate)")


def save_multi_rate(
    path: Path, network: NetworkType, model: N, lmbdas: tuple[float, ...], card: Mapping[str, Any]
) -> None:
    """Write a trained network for several rates to a file of weights.

    Parameters
    ----------
    path
        File to write.
    network
        The kind of network, whose name is stored.
    model
        The trained network.
    lmbdas
        Lagrangian weight of each rate, lowest bitrate first.
    card
        Model card, such as the training data, which is stored as JSON.
    """
    rounded = type(model)(model.shape)
    rounded.load_state_dict({name: each.cpu().half() for name, each in model.state_dict().items()})
    header_fields = {
        "network": network.name,
        "shape": model.shape.model_dump(),
        "lmbdas": lmbdas,
        "card": dict(card),
    }
    write_weights(
        path, header_fields, rounded.state_dict(), _tensors_of_tables(_tables_of(rounded))
    )


def load_multi_rate(
    path: Path,
    network: NetworkType,
    model_type: type[N],
    load_published: Callable[[Path], N],
) -> MultiRateWeights[N]:
    """Read weights of a network for one or several rates.

    Parameters
    ----------
    path
        A ``.safetensors`` file that `save_multi_rate` wrote, or a file of the network's authors.
    network
        The kind of network.
    model_type
        Class of the network.
    load_published
        Function that reads a file of the authors.

    Raises
    ------
    InputError
        If the file is damaged or of another network.
    """
    if path.suffix == SUFFIX:
        return _load_our_set(path, model_type)
    model = load_published(path)
    tables = _tables_of(model)
    digest = digest_of(read_bytes(path) + json.dumps(_json_of_tables(tables)).encode())
    card = {"origin": "authors' weights", "file": path.name}
    return MultiRateWeights(model, network.lmbdas_of(path), tables, digest, card)


def _load_our_set(path: Path, model_type: type[N]) -> MultiRateWeights[N]:
    contents = read_weights(path)
    header = contents.header
    try:
        model = model_type(parsed(model_type.Shape, header.shape, f"{path}: shape"))
        model.load_state_dict(contents.state)
        tables = _tables_of_tensors(contents.integers)
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        raise InputError(f"{path}: damaged weights") from error
    if not len(tables) == len(header.lmbdas) == model.shape.rates:
        raise InputError(f"{path}: damaged weights (rates)")
    return MultiRateWeights(model.eval(), header.lmbdas, tables, contents.digest, header.card)


def _tables_of(model: MultiRateNetwork) -> Tables:
    rates = range(model.shape.rates)
    return tuple(frequency_tables(model.entropy_bottleneck(rate)) for rate in rates)


def _tensors_of_tables(tables: Tables) -> dict[str, NDArray[np.int32]]:
    """Return tables as lowest values and lengths (rates, channels), and all frequencies (n,)."""
    lowest = np.array([[table.lowest for table in rate] for rate in tables], np.int32)
    length = np.array([[len(table.frequencies) for table in rate] for rate in tables], np.int32)
    frequencies = np.concatenate([table.frequencies for rate in tables for table in rate])
    return dict(zip(_TABLES, (lowest, length, frequencies), strict=True))


def _tables_of_tensors(arrays: Arrays) -> Tables:
    lowest, length, frequencies = (arrays[name] for name in _TABLES)
    is_possible = lowest.ndim == 2 and lowest.shape == length.shape and frequencies.ndim == 1
    if not is_possible or (length < 2).any() or length.sum(dtype=np.int64) != len(frequencies):
        raise ValueError("tables of other sizes")
    if (frequencies < 1).any() or (np.abs(lowest.astype(np.int64)) > _MAX_MAGNITUDE).any():
        raise ValueError("tables with impossible numbers")
    parts = iter(np.split(frequencies, np.cumsum(length.ravel())[:-1]))
    return tuple(
        tuple(FrequencyTable(lowest_value, next(parts)) for lowest_value in row)
        for row in lowest.tolist()
    )


def _json_of_tables(tables: Tables) -> list[list[dict[str, Any]]]:
    return [
        [{"lowest": t.lowest, "frequencies": t.frequencies.tolist()} for t in rate]
        for rate in tables
    ]


D = TypeVar("D", bound=np.floating[Any])


@contextmanager
def telling(fault: str) -> Iterator[None]:
    """Raise InputError if code that reads a checkpoint finds parameters missing or unsuitable.

    This is a context manager around that code. The message is `fault`, with the reason in brackets.
    The errors that are replaced are those of Python and PyTorch for missing or unsuitable
    parameters, and the ValueError of `checkpoint_arrays`.
    """
    try:
        yield
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        reason = str(error).splitlines()[-1].strip() if str(error) else type(error).__name__
        raise InputError(f"{fault} ({reason})") from error


def checkpoint_arrays(
    checkpoint: Mapping[str, Any], shapes: Mapping[str, tuple[int, ...]], dtype: type[D]
) -> dict[str, NDArray[D]]:
    """Return parameters of a checkpoint as NumPy arrays, by name.

    `shapes` has the names and the expected shapes, `dtype` is the element type of the arrays.

    Raises ValueError if a parameter has another shape than that in `shapes`, or is not finite.
    """
    arrays = {}
    for name, shape in shapes.items():
        array = checkpoint[name].numpy().astype(dtype)
        if array.shape != shape or not np.isfinite(array).all():
            raise ValueError(f"{name}: shape {array.shape}, or not finite")
        arrays[name] = array
    return arrays


_UNREADABLE = (
    OSError, RuntimeError, EOFError, LookupError, ValueError, TypeError, AttributeError
)  # fmt: skip


def read_checkpoint(path: Path, fault: str) -> dict[str, Any]:
    """Read a dictionary that PyTorch saved, without running code from the file.

    Parameters
    ----------
    path
        File to read.
    fault
        Error message if the file is damaged or is no dictionary.

    Raises
    ------
    InputError
        If the file is damaged or is no dictionary.
    """
    return _checkpoint(path, f"{path}: {fault}")


def checkpoint_of(data: bytes, fault: str) -> dict[str, Any]:
    """Return the dictionary in the bytes of a file that PyTorch saved, without running code.

    Raises InputError with the message `fault` if the bytes are damaged or are no dictionary.
    """
    return _checkpoint(BytesIO(data), fault)


def _checkpoint(source: Path | BytesIO, fault: str) -> dict[str, Any]:
    try:
        checkpoint = torch.load(source, map_location="cpu", weights_only=True)
    except (*_UNREADABLE, pickle.UnpicklingError) as error:
        raise InputError(fault) from error
    if not isinstance(checkpoint, dict):
        raise InputError(fault)
    return checkpoint
