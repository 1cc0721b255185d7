"""Random generators for named artefacts."""

from __future__ import annotations

import hashlib

import numpy as np


def generator(seed: int, *names: str) -> np.random.Generator:
    """Return the generator of one artefact: equal seeds and names give equal numbers everywhere.

    Parameters
    ----------
    seed
        Seed of the configuration.
    *names
        Name of the artefact in parts, such as ``"scan", "office_1", "noise"``. Artefacts of one
        seed are independent.
    """
    digest = hashlib.sha256("\0".join(names).encode()).digest()
    words = np.frombuffer(digest, dtype="<u4").tolist()
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, *words])))
