from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cloud_files.clouds import read_cloud
from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from pointkit.measurement import Cost
from puckbench.codecs.base import CloudKind, Codec
from puckbench.core.code import CLOUD_FILES
from puckbench.core.programs import run_program

CODE = (*CLOUD_FILES, "puckbench.core.launch", "puckbench.core.programs")

_MEMORY_BYTES, _MEMORY_PER_BYTE = 2**31, 400
_SECONDS, _SECONDS_PER_BYTE = 30, 1e-4
"""Limits of a program's memory (bytes) and time (s): constants, and increments per input byte."""


def program_names(codec: Codec) -> tuple[str, ...]:
    """Return the names or paths of the programs that a codec runs; empty if it runs none."""
    return codec.programs if isinstance(codec, ExternalCodec) else ()


class ExternalCodec(Codec):
    """Base class of codecs that run external programs to encode and decode.

    A subclass lists the programs in `programs` and calls `run` in `encode` and `decode`. The cost
    of a call is that of the programs, including reading and writing files.
    """

    output: str = ""
    """The text that the last program wrote to its output."""
    programs_cost: Cost | None = None
    """Cost of the programs that the last encoding or decoding ran; None if it ran none."""

    @property
    def programs(self) -> tuple[str, ...]:
        """The names or paths of the required programs; a subclass may define an attribute."""
        return ()

    def skip(self, cloud: CloudKind, rate: str) -> str | None:
        missing = [name for name in self.programs if shutil.which(name) is None]
        return super().skip(cloud, rate) or (f"no program '{missing[0]}'" if missing else None)

    def run(self, command: Sequence[str | Path], source: Path) -> None:
        """Run an external program, with limits on its time and memory.

        Parameters
        ----------
        command
            The program and its arguments.
        source
            The input file. The limits grow with its size.

        Raises
        ------
        InputError
            The program fails or exceeds a limit.
        """
        size = source.stat().st_size
        memory_bytes = _MEMORY_BYTES + size * _MEMORY_PER_BYTE
        seconds = _SECONDS + size * _SECONDS_PER_BYTE
        cost, self.output = run_program(command, memory_bytes, seconds)
        self.programs_cost = self.programs_cost.plus(cost) if self.programs_cost else cost


@contextmanager
def folder() -> Iterator[Path]:
    """Yield a new temporary folder, and delete it at the end of the context."""
    with tempfile.TemporaryDirectory(prefix="puckbench-") as path:
        yield Path(path)


def write_points(path: Path, points: NDArray[Any], kind: str) -> None:
    """Write points to a binary PLY file.

    Parameters
    ----------
    path
        The file to write.
    points
        Points (n, 3).
    kind
        Type of the coordinates in the file: "float32" or "float64".
    """
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}"]
    header += [f"property {kind} {axis}" for axis in "xyz"]
    rows = np.ascontiguousarray(points, dtype=np.dtype(kind).newbyteorder("<"))
    path.write_bytes("\n".join([*header, "end_header\n"]).encode() + rows.tobytes())


def read_points(path: Path, what: str) -> Floats:
    """Read the points (m, 3) of a PLY file that an external program wrote.

    Parameters
    ----------
    path
        The file to read.
    what
        Name of the program, with which the message of an error begins.

    Raises
    ------
    InputError
        The file is missing or has no points.
    """
    try:
        return read_cloud(path, keep_missing=True).xyz
    except InputError as error:
        raise InputError(f"{what}: no points came back ({error})") from error
