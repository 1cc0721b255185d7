"""A set of weights: the network, integer tables for each rate, and where they come from.

Our own format is one file: magic, version and length, a JSON header (shape, alphas, tables, names
and shapes of tensors, model card), then the tensors in half precision, one after the other.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from puckbench.codecs.pcgcv2.bottleneck import Table, tables
from puckbench.codecs.pcgcv2.catalogue import MAGIC, START, SUFFIX, VERSION, alphas_of, header_of
from puckbench.codecs.pcgcv2.model import PCGCv2, Shape
from puckbench.codecs.pcgcv2.originals import load_original
from puckbench.errors import InputError
from puckbench.files import read_bytes, write_bytes

_DIGEST = 8


@dataclass(frozen=True)
class WeightSet:
    """A network ready for coding.

    alphas: of its rates, the smallest bitrate first. tables: for each rate, for each channel.
    digest: 8 bytes that name these weights and tables. card: what is known about them.
    """

    model: PCGCv2
    alphas: tuple[float, ...]
    tables: tuple[tuple[Table, ...], ...]
    digest: bytes
    card: Mapping[str, Any]


def load_weights(path: Path) -> WeightSet:
    """Read our own set or one of the authors' checkpoints; InputError when it is neither."""
    return _load_own(path) if path.suffix == SUFFIX else _load_original(path)


def _load_original(path: Path) -> WeightSet:
    model = load_original(path)
    made = (tables(model.bottleneck(0)),)
    digest = _digest(read_bytes(path) + json.dumps(_plain(made)).encode())
    card = {"origin": "authors' checkpoint", "file": path.name}
    return WeightSet(model, tuple(alphas_of(path)), made, digest, card)


def _digest(data: bytes) -> bytes:
    return hashlib.sha256(data).digest()[:_DIGEST]


def _plain(sets: tuple[tuple[Table, ...], ...]) -> list[list[dict[str, Any]]]:
    return [
        [{"lowest": t.lowest, "frequencies": t.frequencies.tolist()} for t in rate] for rate in sets
    ]


def save_weights(
    path: Path, model: PCGCv2, alphas: tuple[float, ...], card: Mapping[str, Any]
) -> WeightSet:
    """Write a network as a set of our own; the tables are made here, from what is written.

    Returns the set as `load_weights` reads it.
    """
    halves = {name: value.detach().half().cpu() for name, value in model.state_dict().items()}
    rounded = PCGCv2(model.shape)
    rounded.load_state_dict({name: value.float() for name, value in halves.items()})
    made = tuple(tables(rounded.bottleneck(rate)) for rate in range(model.shape.rates))
    header = {
        "shape": asdict(model.shape),
        "alphas": list(alphas),
        "tables": _plain(made),
        "tensors": [{"name": name, "shape": list(v.shape)} for name, v in halves.items()],
        "card": dict(card),
    }
    text = json.dumps(header, sort_keys=True).encode()
    body = b"".join(value.numpy().astype("<f2").tobytes() for value in halves.values())
    write_bytes(path, START.pack(MAGIC, VERSION, len(text)) + text + body)
    return load_weights(path)


def _load_own(path: Path) -> WeightSet:
    header, data = header_of(path), read_bytes(path)
    at = START.size + START.unpack_from(data)[2]
    try:
        shape = Shape(**header["shape"])
        model = PCGCv2(replace(shape, widths=tuple(header["shape"]["widths"])))
        model.load_state_dict(_tensors(header["tensors"], data[at:]))
        read = tuple(tuple(_table(table) for table in rate) for rate in header["tables"])
        alphas = tuple(float(alpha) for alpha in header["alphas"])
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        raise InputError(f"{path}: damaged weights") from error
    if not len(read) == len(alphas) == shape.rates:
        raise InputError(f"{path}: damaged weights (rates)")
    return WeightSet(model.eval(), alphas, read, _digest(data), header["card"])


def _tensors(named: list[dict[str, Any]], data: bytes) -> dict[str, torch.Tensor]:
    values = np.frombuffer(data, dtype="<f2").astype(np.float32)
    sizes = [int(np.prod(entry["shape"])) for entry in named]
    if sum(sizes) != len(values):
        raise ValueError("tensors and data differ in size")
    parts = np.split(values, np.cumsum(sizes)[:-1])
    return {
        entry["name"]: torch.from_numpy(part.reshape(entry["shape"]).copy())
        for entry, part in zip(named, parts, strict=True)
    }


def _table(plain: Mapping[str, Any]) -> Table:
    return Table(int(plain["lowest"]), np.array(plain["frequencies"], dtype=np.int32))
