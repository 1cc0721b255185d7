"""A set of weights: the network, integer tables for each rate, and where they come from."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from puckbench.codecs.pcgcv2.bottleneck import tables
from puckbench.codecs.pcgcv2.catalogue import SUFFIX, alphas_of
from puckbench.codecs.pcgcv2.model import PCGCv2, Shape
from puckbench.codecs.pcgcv2.originals import load_original
from puckbench.codecs.weightsfile import (
    TableSets,
    digest_of,
    halved,
    plain_tables,
    read_weights,
    tables_of,
    write_weights,
)
from puckbench.errors import InputError
from puckbench.files import read_bytes


@dataclass(frozen=True)
class WeightSet:
    """A network ready for coding.

    alphas: of its rates, the smallest bitrate first. tables: for each rate, for each channel.
    digest: 8 bytes that name these weights and tables. card: what is known about them.
    """

    model: PCGCv2
    alphas: tuple[float, ...]
    tables: TableSets
    digest: bytes
    card: Mapping[str, Any]


def load_weights(path: Path) -> WeightSet:
    """Read our own set or one of the authors' checkpoints; InputError when it is neither."""
    return _load_own(path) if path.suffix == SUFFIX else _load_original(path)


def _load_original(path: Path) -> WeightSet:
    model = load_original(path)
    made = (tables(model.bottleneck(0)),)
    digest = digest_of(read_bytes(path) + json.dumps(plain_tables(made)).encode())
    card = {"origin": "authors' checkpoint", "file": path.name}
    return WeightSet(model, tuple(alphas_of(path)), made, digest, card)


def save_weights(
    path: Path, model: PCGCv2, alphas: tuple[float, ...], card: Mapping[str, Any]
) -> WeightSet:
    """Write a network as a set of our own; the tables are made here, from what is written.

    Returns the set as `load_weights` reads it.
    """
    rounded = PCGCv2(model.shape)
    rounded.load_state_dict(halved(model.state_dict()))
    made = tuple(tables(rounded.bottleneck(rate)) for rate in range(model.shape.rates))
    header = {
        "shape": asdict(model.shape),
        "alphas": list(alphas),
        "tables": plain_tables(made),
        "card": dict(card),
    }
    write_weights(path, header, rounded.state_dict())
    return load_weights(path)


def _load_own(path: Path) -> WeightSet:
    found = read_weights(path)
    try:
        shape = Shape(**found.header["shape"])
        model = PCGCv2(replace(shape, widths=tuple(found.header["shape"]["widths"])))
        model.load_state_dict(found.state)
        made = tables_of(found.header["tables"])
        alphas = tuple(float(alpha) for alpha in found.header["alphas"])
        card = found.header["card"]
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        raise InputError(f"{path}: damaged weights") from error
    if not len(made) == len(alphas) == shape.rates:
        raise InputError(f"{path}: damaged weights (rates)")
    return WeightSet(model.eval(), alphas, made, found.digest, card)
