"""The sets of trained weights of each network: shipped ones, files and folders, without PyTorch.

A set of puckbench is a safetensors file (``*.safetensors``) with a `WeightsHeader` in its metadata;
some are shipped. The authors of a network publish one file for each rate, whose name tells the
rate.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from puckbench.core.errors import InputError
from puckbench.core.files import unreadable
from puckbench.core.models import Model, among

SUFFIX = ".safetensors"
HEADER_KEY = "puckbench"
"""The one entry of a file's metadata: the header as JSON."""
MAX_FILE_BYTES = 2**28
_PUBLISHED = (".npz", ".pth", ".pt")


class WeightsHeader(Model):
    """What the metadata of a set of weights say of it.

    Parameters
    ----------
    network
        Name of the network (see `NetworkType`).
    shape
        Sizes of the network, the arguments of its `Shape`.
    lmbdas
        Lagrangian weights of the rates, the smallest bitrate first; none for a lossless network.
    card
        Model card: what the set was trained on and how well it codes.
    sha256
        Hexadecimal SHA-256 of the tensors' bytes, which is verified when they are read.
    digest
        The 16 hexadecimal digits by which streams name the set. By default those that the SHA-256
        of the file begins with; sets that were converted from an older format keep theirs.
    """

    network: str
    shape: dict[str, Any]
    lmbdas: tuple[float, ...]
    card: dict[str, Any]
    sha256: str
    digest: str | None = None


def header_of(path: Path) -> WeightsHeader:
    """The header of a set of weights, without its tensors.

    Raises
    ------
    InputError
        The file is unreadable, damaged, too large, or not a set of weights.
    """
    try:
        state = path.stat()
        return _header(path, state.st_mtime_ns, state.st_size)
    except OSError as error:
        raise unreadable(path, error) from error


@lru_cache(maxsize=64)
def _header(path: Path, _changed: int, size: int) -> WeightsHeader:
    """Read once for each state of a file: headers are asked for at every call of a codec."""
    from safetensors import SafetensorError, safe_open

    if size > MAX_FILE_BYTES:
        raise InputError(f"{path}: damaged weights (more than {MAX_FILE_BYTES} bytes)")
    try:
        with safe_open(path, framework="np") as file:
            return WeightsHeader.model_validate_json((file.metadata() or {})[HEADER_KEY])
    except (SafetensorError, KeyError, ValueError) as error:
        raise InputError(f"{path}: damaged weights, or not a set of weights") from error


def shipped() -> dict[str, Path]:
    """The sets that come with puckbench, by name."""
    folder = Path(str(files("puckbench.learned").joinpath("weights")))
    return {path.stem: path for path in sorted(folder.glob(f"*{SUFFIX}"))}


def weights_path(where: str | Path) -> Path:
    """Return the file of a shipped set by its name; any other argument is taken as a path."""
    return shipped().get(str(where), Path(where))


def weights_files(where: str) -> list[Path]:
    """The files that the option `weights` means, of any network.

    Parameters
    ----------
    where
        Name of a shipped set, a file, or a folder.

    Raises
    ------
    InputError
        It is none of these.
    """
    if where in shipped():
        return [shipped()[where]]
    path = Path(where)
    if path.is_file():
        return [path]
    if not path.is_dir():
        known = among(where, shipped())
        raise InputError(f"{path}: no such folder of weights, nor file, nor shipped set{known}")
    return sorted(file for file in path.iterdir() if file.suffix in (SUFFIX, *_PUBLISHED))


def weights_file(where: str) -> Path:
    """The one file that `weights_files` finds; InputError when there are others or none."""
    found = weights_files(where)
    if len(found) != 1:
        raise InputError(f"{where}: not one file of weights but {len(found)}")
    return found[0]


@dataclass(frozen=True)
class NetworkType:
    """A network as its weights name it.

    Parameters
    ----------
    name
        In the headers of its sets.
    published
        Regular expression of the names of its authors' files, if there are any; its one group is
        what `lmbda` turns into the Lagrangian weight of the rate.
    """

    name: str
    published: str | None = None
    lmbda: Callable[[str], float] = float

    def has(self, path: Path) -> bool:
        """Whether a file holds weights of this network, by its name and header."""
        if path.suffix == SUFFIX:
            return header_of(path).network == self.name
        return self._published(path) is not None

    def files(self, where: str) -> list[Path]:
        """Its files where the option `weights` says, by name; InputError as `weights_files`."""
        return [path for path in weights_files(where) if self.has(path)]

    def shipped(self) -> list[Path]:
        """Its sets that come with puckbench."""
        return [path for path in shipped().values() if self.has(path)]

    def lmbdas_of(self, path: Path) -> tuple[float, ...]:
        """The Lagrangian weights that one of its files was trained with."""
        if path.suffix == SUFFIX:
            return header_of(path).lmbdas
        found = self._published(path)
        return (self.lmbda(found[1]),) if found else ()

    def by_lmbda(self, where: str) -> dict[float, Path]:
        """For each lambda the file with its weights, the last by name; InputError as `files`."""
        return {lmbda: path for path in self.files(where) for lmbda in self.lmbdas_of(path)}

    def _published(self, path: Path) -> re.Match[str] | None:
        return re.fullmatch(self.published, path.name) if self.published else None


def _tenths(digits: str) -> float:
    """``025`` is 0.25, ``10`` is 10."""
    return float(f"0.{digits[1:]}" if digits.startswith("0") else digits)


PCGCV1 = NetworkType("pcgcv1", r"a(\d+(?:\.\d+)?)b3\.npz")
"""The authors' ``a0.75b3.npz`` was trained with lambda 0.75."""
PCGCV2 = NetworkType("pcgcv2", r"c8_a(\d+)_\d+\.pth", _tenths)
"""The authors' ``c8_a025_32000.pth`` was trained with lambda 0.25."""
OCTREE_NET = NetworkType("sparse_octree_net")
RENO = NetworkType("reno", r"([\w.-]+)\.pt")
"""The authors' ``KITTIDetection.pt``; its rates need no weights of their own."""
