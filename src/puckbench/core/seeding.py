"""Random generators named after the artefact that they make."""

from __future__ import annotations

import hashlib

import numpy as np


def generator(seed: int, *names: str) -> np.random.Generator:
    """Generator for one artefact: the same seed and names give the same numbers everywhere.

    Parameters
    ----------
    seed
        The configured seed.
    *names
        What is made, for example ``"scan", "office_1", "noise"``: artefacts made from one seed are
        independent, and adding one changes no other.
    """
    digest = hashlib.sha256("\0".join(names).encode()).digest()
    words = np.frombuffer(digest, dtype="<u4").tolist()
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, *words])))
