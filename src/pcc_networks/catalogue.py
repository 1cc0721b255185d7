"""Lookup of trained weights by name, file or folder, without importing PyTorch.

puckbench stores weights as ``*.safetensors`` with a `WeightsHeader` in the metadata. The authors of
a network publish one file per rate, with the rate in the name of the file.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from pointkit.errors import InputError, among
from pointkit.files import refuse_special, unreadable
from pointkit.models import Model

SUFFIX = ".safetensors"
HEADER_KEY = "puckbench"
"""Key of the JSON header in the metadata of a file."""
MAX_FILE_BYTES = 2**28
_PUBLISHED = (".npz", ".pth", ".pt", ".bin", ".zip")


class WeightsHeader(Model):
    """What a file of trained weights says about itself, stored as JSON in its metadata."""

    network: str  # name of the `NetworkType`
    shape: dict[str, Any]  # sizes of the network
    # Lagrangian weights of the rates, lowest bitrate first; empty for lossless networks
    lmbdas: tuple[float, ...]
    card: dict[str, Any]  # model card: training data, and how well the set codes
    sha256: str  # of the bytes of the tensors
    # 16 hexadecimal digits by which streams name the set, by default the first of the SHA-256 of
    # the file; sets converted from an older format keep theirs
    digest: str | None = None


def header_of(path: Path) -> WeightsHeader:
    """Return the header of a file of weights, without reading the weights.

    Raises
    ------
    InputError
        If the file does not exist, is damaged, or has no such header.
    """
    refuse_special(path)
    try:
        state = path.stat()
        return _header(path, state.st_mtime_ns, state.st_size)
    except OSError as error:
        raise unreadable(path, error) from error


# Headers are cached by the file's state, since each call of a codec needs one.
@lru_cache(maxsize=64)
def _header(path: Path, _mtime: int, size: int) -> WeightsHeader:
    from safetensors import SafetensorError, safe_open

    if size > MAX_FILE_BYTES:
        raise InputError(f"{path}: damaged weights (more than {MAX_FILE_BYTES} bytes)")
    try:
        with safe_open(path, framework="np") as file:
            return WeightsHeader.model_validate_json((file.metadata() or {})[HEADER_KEY])
    except (SafetensorError, KeyError, ValueError) as error:
        raise InputError(f"{path}: damaged weights, or not a set of weights") from error


def shipped() -> dict[str, Path]:
    """Return the files of weights that come with the package, as a mapping from names to paths."""
    folder = Path(str(files("pcc_networks").joinpath("weights")))
    return {path.stem: path for path in sorted(folder.glob(f"*{SUFFIX}"))}


def weights_path(where: str | Path) -> Path:
    """Return the path of weights.

    Parameters
    ----------
    where
        Name of weights that come with the package, or the path of a file. A path is returned
        unchanged, whether or not the file exists.
    """
    return shipped().get(str(where), Path(where))


def weights_files(where: str) -> list[Path]:
    """Return the paths of files of weights, of any network.

    Parameters
    ----------
    where
        Name of weights that come with the package, path of a file, or path of a folder. All files
        of weights in a folder are returned, in the order of their names.

    Raises
    ------
    InputError
        If there is no such name, file or folder.
    """
    if where in shipped():
        return [shipped()[where]]
    path = Path(where)
    if path.is_file():
        return [path]
    if not path.is_dir():
        suggestion = among(where, shipped())
        raise InputError(
            f"{path}: no such folder of weights, nor file, nor shipped set{suggestion}"
        )
    return sorted(file for file in path.iterdir() if file.suffix in (SUFFIX, *_PUBLISHED))


def weights_file(where: str) -> Path:
    """Return the path of the only file of weights that `weights_files` finds.

    Raises InputError if there is not exactly one.
    """
    paths = weights_files(where)
    if len(paths) != 1:
        raise InputError(f"{where}: {len(paths)} files of weights, expected one")
    return paths[0]


@dataclass(frozen=True)
class NetworkType:
    """A network whose files of weights can be recognised by their headers or names."""

    name: str  # in the headers of its sets
    # regular expression of the names of the authors' files, with one group
    published: str | None = None
    lmbda: Callable[[str], float] = float  # turns the group into the Lagrangian weight of the rate

    def has(self, path: Path) -> bool:
        """Return whether a file contains weights of this network."""
        if path.suffix == SUFFIX:
            return header_of(path).network == self.name
        return self._published(path) is not None

    def files(self, where: str) -> list[Path]:
        """Return the paths from `weights_files` that contain weights of this network."""
        return [path for path in weights_files(where) if self.has(path)]

    def shipped(self) -> list[Path]:
        """Return the paths of this network's weights that come with the package."""
        return [path for path in shipped().values() if self.has(path)]

    def lmbdas_of(self, path: Path) -> tuple[float, ...]:
        """Return the Lagrangian weights of the rates in a file, the lowest bitrate first."""
        if path.suffix == SUFFIX:
            return header_of(path).lmbdas
        match = self._published(path)
        return (self.lmbda(match[1]),) if match else ()

    def by_lmbda(self, where: str) -> dict[float, Path]:
        """Return a mapping from the Lagrangian weight of each rate to a file with this rate.

        If several files have the same rate, the last one by name is taken.
        """
        return {lmbda: path for path in self.files(where) for lmbda in self.lmbdas_of(path)}

    def _published(self, path: Path) -> re.Match[str] | None:
        return re.fullmatch(self.published, path.name) if self.published else None


def _tenths(digits: str) -> float:
    return float(f"0.{digits[1:]}" if digits.startswith("0") else digits)


PCGCV1 = NetworkType("pcgcv1", r"a(\d+(?:\.\d+)?)b3\.npz")
"""The authors' ``a0.75b3.npz`` was trained with lambda 0.75."""
PCGCV2 = NetworkType("pcgcv2", r"c8_a(\d+)_\d+\.pth", _tenths)
"""The authors' ``c8_a025_32000.pth`` was trained with lambda 0.25."""
OCTREE_NET = NetworkType("sparse_octree_net")
RENO = NetworkType("reno", r"([\w.-]+)\.pt")
"""The authors' ``KITTIDetection.pt`` serves all rates."""
LIZIP = NetworkType("lizip", r"([\w.-]+)\.bin")
"""The authors' ``mlp_c3_h256.bin`` serves all rates."""
POLOPCAC = NetworkType("polopcac", r"([\w.-]+)\.pt")
"""The authors' only file is ``ckpt.pt``."""
INTER_LPCM = NetworkType("inter_lpcm", r"(.+)\.zip")
"""An archive of the authors' repository has the files of all networks."""
_NETWORKS = (PCGCV1, PCGCV2, OCTREE_NET, RENO, LIZIP, POLOPCAC, INTER_LPCM)
NETWORKS = {network.name: network for network in _NETWORKS}
