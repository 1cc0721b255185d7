"""Which file of a folder holds the learned octree coder's weights, without loading PyTorch."""

from __future__ import annotations

from pathlib import Path

from puckbench.codecs.pcgcv2.catalogue import SUFFIX, header_of
from puckbench.errors import InputError

NETWORK = "sparse_octree_net"
"""The network's name in the header of a set."""


def weights_in(folder: Path) -> list[Path]:
    """Sets for this network, by name; InputError when the folder has none."""
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder of weights")
    found = [
        path
        for path in sorted(folder.glob(f"*{SUFFIX}"))
        if header_of(path).get("network") == NETWORK
    ]
    if not found:
        raise InputError(f"{folder} has no weights for {NETWORK}")
    return found
