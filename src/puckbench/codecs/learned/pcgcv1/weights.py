"""PCGCv1's weights: sets of our own, or the authors' archives; laid out for coding."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from puckbench.codecs.learned.pcgcv1.catalogue import NETWORK
from puckbench.codecs.learned.pcgcv1.inference import Inference
from puckbench.codecs.learned.pcgcv1.integer_hyper_decoder import ExactHyperDecoder
from puckbench.codecs.learned.pcgcv1.model import PCGCv1, Shape
from puckbench.codecs.learned.pcgcv1.published_weights import load_original
from puckbench.codecs.learned.rate_set import load_rated, save_rated
from puckbench.codecs.learned.weights_file import TableSets
from puckbench.core.errors import InputError


@dataclass(frozen=True)
class WeightSet:
    """A network ready for coding, its layers laid out once; the rest as in `RatedSet`.

    tables: of the hyper-latent.
    """

    shape: Shape
    network: Inference
    hyper_decoder: ExactHyperDecoder
    alphas: tuple[float, ...]
    tables: TableSets
    digest: bytes
    card: Mapping[str, Any]


def load_weights(path: Path) -> WeightSet:
    """Read our own set or one of the authors' archives; InputError when it is neither."""
    found = load_rated(path, NETWORK, lambda sizes: PCGCv1(Shape(**sizes)), load_original)
    try:
        exact = ExactHyperDecoder(found.model.hyper_decoder)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    rest = (found.alphas, found.tables, found.digest, found.card)
    return WeightSet(found.model.shape, Inference(found.model), exact, *rest)


def save_weights(
    path: Path, model: PCGCv1, alphas: tuple[float, ...], card: Mapping[str, Any]
) -> WeightSet:
    """Write a network as a set of our own; returns it as `load_weights` reads it."""
    save_rated(path, NETWORK, model, alphas, card)
    return load_weights(path)
