from __future__ import annotations

import hashlib

import numpy as np


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
