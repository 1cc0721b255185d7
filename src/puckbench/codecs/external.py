"""Codecs that are programs of others: run under limits, timed and weighed on their own."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from puckbench.codecs import launch
from puckbench.codecs.base import Availability, Codec, Cost
from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats
from puckbench.io.clouds import read_cloud

_MEMORY_BYTES = 2**31
_SECONDS = 30
"""What a tool may take, and more for each byte of its input."""
_MEMORY_PER_BYTE = 400
_SECONDS_PER_BYTE = 1e-4


class ExternalCodec(Codec):
    """A codec that runs other people's programs on files in a temporary folder.

    A class names its `programs`, and its `_encode` and `_decode` call `run` with a command line.
    The cost is that of the programs' processes, from their start to their end, with their own
    reading and writing of files, and without the memory of this process.
    """

    said: str = ""
    """What the program that ran last printed."""

    @property
    def programs(self) -> tuple[str, ...]:
        """Names or paths of the programs that it needs; a class may just assign them."""
        return ()

    def available(self) -> Availability:
        """Whether the programs are there."""
        missing = [name for name in self.programs if shutil.which(name) is None]
        return Availability(not missing, f"no program '{missing[0]}'" if missing else "")

    def cost(self, here: Cost) -> Cost:
        """Time and memory of the program that ran last."""
        return self._cost or here

    _cost: Cost | None = None

    def run(self, command: Sequence[str | Path], source: Path) -> None:
        """Run a program under limits of time and memory that grow with its input.

        Parameters
        ----------
        command
            Program and arguments.
        source
            The file that the program reads, whose size sets the limits.

        Raises
        ------
        InputError
            The program fails or exceeds its limits; its last line is in the message.
        """
        size = source.stat().st_size
        limits = (_MEMORY_BYTES + size * _MEMORY_PER_BYTE, _SECONDS + size * _SECONDS_PER_BYTE)
        words = [sys.executable, "-I", "-S", launch.__file__, *(str(int(x)) for x in limits)]
        ran = subprocess.run([*words, *map(str, command)], capture_output=True, check=False)
        self.said = ran.stderr.decode(errors="replace").strip()
        ended: dict[str, Any] = {"status": "not started"}
        if ran.returncode == 0:
            ended = json.loads(ran.stdout)
        if ended["status"] != 0:
            last = self.said.rpartition("\n")[2][:80]
            failed = f"{Path(command[0]).name} failed"
            raise InputError(f"codec {self.name}: {failed} ({ended['status']}: {last})")
        self._cost = Cost(ended["seconds"], ended["peak_kib"] / 1024)


@contextmanager
def folder() -> Iterator[Path]:
    """A temporary folder for one call's files."""
    with tempfile.TemporaryDirectory(prefix="puckbench-") as path:
        yield Path(path)


def write_points(path: Path, points: NDArray[Any], kind: str) -> None:
    """Write points as binary PLY without any other property.

    Parameters
    ----------
    path
        Of the file.
    points
        (n, 3) coordinates.
    kind
        ``float32`` or ``float64``, the names that programs read.
    """
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}"]
    header += [f"property {kind} {axis}" for axis in "xyz"]
    rows = np.ascontiguousarray(points, dtype=np.dtype(kind).newbyteorder("<"))
    path.write_bytes("\n".join([*header, "end_header\n"]).encode() + rows.tobytes())


def read_points(path: Path, what: str) -> Floats:
    """Read the points that a program wrote.

    Parameters
    ----------
    path
        Of a PLY file.
    what
        The codec and its program, for the message.

    Returns
    -------
    Floats
        (m, 3) coordinates.

    Raises
    ------
    InputError
        There is no such file, or it holds no points.
    """
    try:
        return read_cloud(path, keep_missing=True).xyz
    except InputError as error:
        raise InputError(f"{what}: no points came back ({error})") from error
