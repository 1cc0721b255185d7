"""Which files of weights there are, for which network and which rates, without loading PyTorch.

Two kinds of files count: sets in puckbench's own format (``*.pcgw``), some of which are shipped,
and the files of a network's authors, one for each rate, whose names tell the rate.
"""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from puckbench.core.errors import InputError
from puckbench.core.files import unreadable

SUFFIX = ".pcgw"
START = struct.Struct("<4sBI")
"""Magic "PCGW", version, bytes of the JSON header that follows."""
MAGIC, VERSION = b"PCGW", 1
_MOST_HEADER = 2**24
_ORIGINALS = (".npz", ".pth")
_UNNAMED = "pcgcv2"
"""The network of sets that name none: the first that there were."""


def header_of(path: Path) -> dict[str, Any]:
    """The JSON header of a set of our own; InputError when the file is not one."""
    try:
        state = path.stat()
        return _header(path, state.st_mtime_ns, state.st_size)
    except OSError as error:
        raise unreadable(path, error) from error
    except (struct.error, ValueError) as error:
        raise InputError(f"{path}: damaged weights") from error


@lru_cache(maxsize=64)
def _header(path: Path, _changed: int, _size: int) -> dict[str, Any]:
    """Read once for each state of a file: headers are asked for at every call of a codec."""
    with path.open("rb") as file:
        magic, version, size = START.unpack(file.read(START.size))
        if magic != MAGIC or version != VERSION or size > _MOST_HEADER:
            raise InputError(f"{path}: not a set of weights of this version")
        header = json.loads(file.read(size))
    if not isinstance(header, dict):
        raise InputError(f"{path}: damaged weights")
    return header


def shipped() -> dict[str, Path]:
    """The sets that come with puckbench, by name."""
    folder = Path(str(files("puckbench.codecs.learned").joinpath("weights")))
    return {path.stem: path for path in sorted(folder.glob(f"*{SUFFIX}"))}


def weights_files(where: str) -> list[Path]:
    """The files that the option `weights` means: a shipped set's name, a file, or a folder.

    InputError when it is none of these. Whether they hold weights of a network is not looked at.
    """
    if where in shipped():
        return [shipped()[where]]
    path = Path(where)
    if path.is_file():
        return [path]
    if not path.is_dir():
        known = ", ".join(shipped()) or "none"
        raise InputError(f"{path}: no such folder of weights, nor file, nor shipped set ({known})")
    return sorted(file for file in path.iterdir() if file.suffix in (SUFFIX, *_ORIGINALS))


def weights_file(where: str) -> Path:
    """The one file that `weights_files` finds; InputError when there are others or none."""
    found = weights_files(where)
    if len(found) != 1:
        raise InputError(f"{where}: not one file of weights but {len(found)}")
    return found[0]


@dataclass(frozen=True)
class Network:
    """A network as weights name it.

    name: in the header of its sets. originals: names of its authors' files, if it has any, with one
    group that `alpha` turns into the rate.
    """

    name: str
    originals: str | None = None
    alpha: Callable[[str], float] = float

    def has(self, path: Path) -> bool:
        """Whether a file holds weights of this network, by its name and header."""
        if path.suffix == SUFFIX:
            return bool(header_of(path).get("network", _UNNAMED) == self.name)
        return self._original(path) is not None

    def files(self, where: str) -> list[Path]:
        """Its files where the option `weights` says, by name; InputError as `weights_files`."""
        return [path for path in weights_files(where) if self.has(path)]

    def shipped(self) -> list[Path]:
        """Its sets that come with puckbench."""
        return [path for path in shipped().values() if self.has(path)]

    def alphas_of(self, path: Path) -> list[float]:
        """The rates of one of its files, as the alphas that they were trained with."""
        if path.suffix == SUFFIX:
            try:
                return [float(alpha) for alpha in header_of(path)["alphas"]]
            except (KeyError, TypeError, ValueError) as error:
                raise InputError(f"{path}: damaged weights (rates)") from error
        found = self._original(path)
        return [self.alpha(found[1])] if found else []

    def by_alpha(self, where: str) -> dict[float, Path]:
        """For each alpha the file with its weights, the last by name; InputError as `files`."""
        return {alpha: path for path in self.files(where) for alpha in self.alphas_of(path)}

    def _original(self, path: Path) -> re.Match[str] | None:
        return re.fullmatch(self.originals, path.name) if self.originals else None
