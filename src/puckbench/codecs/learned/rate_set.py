"""A set of weights for several rates: the network, integer tables for each rate, and a card."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

from puckbench.codecs.learned.catalogue import SUFFIX, Network
from puckbench.codecs.learned.entropy_bottleneck import tables
from puckbench.codecs.learned.gains import Gained
from puckbench.codecs.learned.weights_file import (
    TableSets,
    digest_of,
    halved,
    plain_tables,
    read_weights,
    tables_of,
    write_weights,
)
from puckbench.core.errors import InputError
from puckbench.core.files import read_bytes

M = TypeVar("M", bound=Gained)
Sizes = Mapping[str, Any]


@dataclass(frozen=True)
class RatedSet(Generic[M]):
    """A network ready for coding.

    alphas: of its rates, the smallest bitrate first. tables: of its bottlenecks, for each rate, for
    each channel. digest: 8 bytes that name these weights and tables. card: what is known of them.
    """

    model: M
    alphas: tuple[float, ...]
    tables: TableSets
    digest: bytes
    card: Mapping[str, Any]


def save_rated(
    path: Path, network: Network, model: M, alphas: tuple[float, ...], card: Mapping[str, Any]
) -> None:
    """Write a network as a set of our own; the tables are made here, from what is written."""
    rounded = type(model)(model.shape)
    rounded.load_state_dict(halved(model.state_dict()))
    made = tuple(tables(rounded.bottleneck(rate)) for rate in range(model.shape.rates))
    header = {
        "network": network.name,
        "shape": asdict(model.shape),  # type: ignore[call-overload]
        "alphas": list(alphas),
        "tables": plain_tables(made),
        "card": dict(card),
    }
    write_weights(path, header, rounded.state_dict())


def load_rated(
    path: Path, network: Network, build: Callable[[Sizes], M], original: Callable[[Path], M]
) -> RatedSet[M]:
    """Read a set of our own or a file of the authors'; InputError when it is neither.

    build: makes a network of given sizes. original: reads the authors'.
    """
    if path.suffix == SUFFIX:
        return _own(path, build)
    model = original(path)
    made = (tables(model.bottleneck(0)),)
    digest = digest_of(read_bytes(path) + json.dumps(plain_tables(made)).encode())
    card = {"origin": "authors' weights", "file": path.name}
    return RatedSet(model, tuple(network.alphas_of(path)), made, digest, card)


def _own(path: Path, build: Callable[[Sizes], M]) -> RatedSet[M]:
    found = read_weights(path)
    try:
        model = build({name: _tupled(size) for name, size in found.header["shape"].items()})
        model.load_state_dict(found.state)
        made = tables_of(found.header["tables"])
        alphas = tuple(float(alpha) for alpha in found.header["alphas"])
        card = found.header["card"]
    except (AttributeError, KeyError, TypeError, ValueError, RuntimeError) as error:
        raise InputError(f"{path}: damaged weights") from error
    if not len(made) == len(alphas) == model.shape.rates:
        raise InputError(f"{path}: damaged weights (rates)")
    return RatedSet(model.eval(), alphas, made, found.digest, card)


def _tupled(size: Any) -> Any:
    return tuple(size) if isinstance(size, list) else size
