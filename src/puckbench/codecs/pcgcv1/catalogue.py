"""Which weights of PCGCv1 a folder holds, and for which rates, without loading PyTorch.

Two kinds of files count: our own sets (``*.pcgw``) and the authors' archives, one for each rate
(``a0.75b3.npz`` has alpha 0.75).
"""

from __future__ import annotations

import re
from pathlib import Path

from puckbench.codecs.pcgcv2.catalogue import SUFFIX, header_of
from puckbench.errors import InputError

NETWORK = "pcgcv1"
"""The network's name in the header of a set of our own."""
_ORIGINAL = re.compile(r"a(\d+(?:\.\d+)?)b3\.npz")


def alphas_of(path: Path) -> list[float]:
    """The rates of a file of weights, as the alphas they were trained with; none for others'."""
    if path.suffix == SUFFIX:
        header = header_of(path)
        return [float(a) for a in header["alphas"]] if header.get("network") == NETWORK else []
    named = _ORIGINAL.fullmatch(path.name)
    return [float(named[1])] if named else []


def files_by_alpha(folder: Path) -> dict[float, Path]:
    """For each alpha the file that holds its weights; InputError when there is no such folder."""
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder of weights")
    found: dict[float, Path] = {}
    for path in sorted([*folder.glob("*.npz"), *folder.glob(f"*{SUFFIX}")]):
        for alpha in alphas_of(path):
            found[alpha] = path
    return found
