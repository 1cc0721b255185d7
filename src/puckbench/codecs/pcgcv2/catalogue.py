"""Which weights a folder holds, and for which rates, without loading PyTorch.

Two kinds of files count: our own sets (``*.pcgw``) and the authors' checkpoints, one for each rate
(``c8_a025_32000.pth`` has alpha 0.25).
"""

from __future__ import annotations

import json
import re
import struct
from pathlib import Path
from typing import Any

from puckbench.errors import InputError
from puckbench.files import unreadable

SUFFIX = ".pcgw"
START = struct.Struct("<4sBI")
"""Magic "PCGW", version, bytes of the JSON header that follows."""
MAGIC, VERSION = b"PCGW", 1
_MOST_HEADER = 2**24
_ORIGINAL = re.compile(r"c8_a(\d+)_\d+\.pth")


def header_of(path: Path) -> dict[str, Any]:
    """The JSON header of a set of our own; InputError when the file is not one."""
    try:
        with path.open("rb") as file:
            start = file.read(START.size)
            magic, version, size = START.unpack(start)
            if magic != MAGIC or version != VERSION or size > _MOST_HEADER:
                raise InputError(f"{path}: not a set of weights of this version")
            header: dict[str, Any] = json.loads(file.read(size))
    except OSError as error:
        raise unreadable(path, error) from error
    except (struct.error, ValueError) as error:
        raise InputError(f"{path}: damaged weights") from error
    return header


def alphas_of(path: Path) -> list[float]:
    """The rates of a file of weights, as the alphas they were trained with."""
    if path.suffix == SUFFIX:
        return [float(alpha) for alpha in header_of(path)["alphas"]]
    digits = _ORIGINAL.fullmatch(path.name)
    if digits is None:
        return []
    text = digits[1]
    return [float(f"0.{text[1:]}" if text.startswith("0") else text)]


def files_by_alpha(folder: Path) -> dict[float, Path]:
    """For each alpha the file that holds its weights; InputError when there is no such folder."""
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder of weights")
    found: dict[float, Path] = {}
    for path in sorted([*folder.glob("*.pth"), *folder.glob(f"*{SUFFIX}")]):
        for alpha in alphas_of(path):
            found[alpha] = path
    return found
