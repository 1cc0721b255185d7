"""Files of trained weights, of any learned codec: one file, half precision, integers and a card.

Magic, version and length, a JSON header (the network's name and sizes, its rates, integer tables,
names and shapes of tensors, model card), then the tensors in half precision, one after the other.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from puckbench.codecs.learned.catalogue import MAGIC, START, VERSION, header_of
from puckbench.codecs.learned.entropy_bottleneck import Table
from puckbench.core.errors import InputError
from puckbench.core.files import read_bytes, write_bytes

DIGEST = 8


@dataclass(frozen=True)
class WeightsFile:
    """What a file holds. digest: 8 bytes that name all of it."""

    header: Mapping[str, Any]
    state: dict[str, Tensor]
    digest: bytes


def digest_of(data: bytes) -> bytes:
    """The 8 bytes by which a stream names the weights that made it."""
    return hashlib.sha256(data).digest()[:DIGEST]


def halved(state: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Parameters as a file will keep them, in single precision again: what tables are made from."""
    return {name: value.detach().cpu().half().float() for name, value in state.items()}


def write_weights(path: Path, header: Mapping[str, Any], state: Mapping[str, Tensor]) -> None:
    """Write a set of weights; `header` gets the tensors' names and shapes added."""
    tensors = [{"name": name, "shape": list(value.shape)} for name, value in state.items()]
    text = json.dumps({**header, "tensors": tensors}, sort_keys=True).encode()
    body = b"".join(v.detach().cpu().numpy().astype("<f2").tobytes() for v in state.values())
    write_bytes(path, START.pack(MAGIC, VERSION, len(text)) + text + body)


def read_weights(path: Path) -> WeightsFile:
    """Read a set of weights; InputError when it is damaged or holds numbers that are not finite."""
    header, data = header_of(path), read_bytes(path)
    at = START.size + START.unpack_from(data)[2]
    try:
        state = _tensors(header["tensors"], data[at:])
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path}: damaged weights") from error
    if not all(value.isfinite().all() for value in state.values()):
        raise InputError(f"{path}: damaged weights (not finite)")
    return WeightsFile(header, state, digest_of(data))


def _tensors(named: list[dict[str, Any]], data: bytes) -> dict[str, Tensor]:
    values = np.frombuffer(data, dtype="<f2").astype(np.float32)
    sizes = [int(np.prod(entry["shape"])) for entry in named]
    if sum(sizes) != len(values):
        raise ValueError("tensors and data differ in size")
    parts = np.split(values, np.cumsum(sizes)[:-1])
    return {
        entry["name"]: torch.from_numpy(part.reshape(entry["shape"]).copy())
        for entry, part in zip(named, parts, strict=True)
    }


TableSets = tuple[tuple[Table, ...], ...]
"""For each rate, for each channel."""


def plain_tables(sets: TableSets) -> list[list[dict[str, Any]]]:
    """Tables as JSON has them."""
    return [
        [{"lowest": t.lowest, "frequencies": t.frequencies.tolist()} for t in rate] for rate in sets
    ]


def tables_of(plain: Sequence[Sequence[Mapping[str, Any]]]) -> TableSets:
    """Tables of `plain_tables`; KeyError, TypeError or ValueError for anything else."""
    return tuple(
        tuple(Table(int(t["lowest"]), np.array(t["frequencies"], dtype=np.int32)) for t in rate)
        for rate in plain
    )
