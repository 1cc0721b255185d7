"""Random numbers that depend only on a seed and names."""

from __future__ import annotations

import hashlib

import numpy as np
from numpy.typing import NDArray


def generator(seed: int, *names: str) -> np.random.Generator:
    """Return a generator whose numbers depend only on the seed and the names, on every machine.

    Parameters
    ----------
    seed
        Seed in the configuration.
    *names
        Parts of a name, such as ``"scan", "office_1", "noise"``. Generators with different names
        are independent.
    """
    digest = hashlib.sha256("\0".join(names).encode()).digest()
    words = np.frombuffer(digest, dtype="<u4").tolist()
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, *words])))


def random_rows(count: int, most: int | None, rng: np.random.Generator) -> NDArray[np.int64]:
    """Return at most `most` row numbers out of `count`, drawn at random without repetition.

    Parameters
    ----------
    count
        Number of rows.
    most
        Greatest number of rows to draw; None for all.
    rng
        Source of random numbers.

    Returns
    -------
    array
        Row numbers in ascending order.
    """
    if most is None or count <= most:
        return np.arange(count)
    return np.sort(rng.choice(count, most, replace=False))
