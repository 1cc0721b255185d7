"""PCGCv2's weights: sets of our own, or the authors' checkpoints."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from puckbench.codecs.learned.pcgcv2.catalogue import NETWORK
from puckbench.codecs.learned.pcgcv2.model import PCGCv2, Shape
from puckbench.codecs.learned.pcgcv2.published_weights import load_original
from puckbench.codecs.learned.rate_set import RatedSet, load_rated, save_rated

WeightSet = RatedSet[PCGCv2]


def load_weights(path: Path) -> WeightSet:
    """Read our own set or one of the authors' checkpoints; InputError when it is neither."""
    return load_rated(path, NETWORK, lambda sizes: PCGCv2(Shape(**sizes)), load_original)


def save_weights(
    path: Path, model: PCGCv2, alphas: tuple[float, ...], card: Mapping[str, Any]
) -> WeightSet:
    """Write a network as a set of our own; returns it as `load_weights` reads it."""
    save_rated(path, NETWORK, model, alphas, card)
    return load_weights(path)
