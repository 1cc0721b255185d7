"""Decoders of G-PCC that are separate programs, such as TMC13, for tests of conformance."""

from __future__ import annotations

import shlex
import shutil
import subprocess
import tempfile
from pathlib import Path

from cloud_files.clouds import read_cloud
from gpcc.conformance import CrashError, Decode, rows_of
from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats

SECONDS = 60
"""Time after which a program that decodes a stream is stopped, in s."""
_REFLECTANCES = ("refc", "reflectance")


def program_decoder(words: str) -> Decode:
    """Return a function that decodes a G-PCC stream by running a program.

    Parameters
    ----------
    words
        A command in which ``{stream}`` stands for the input file and ``{points}`` for the output
        file (.ply), or the path of a program that has the options of TMC13's ``tmc3``.

    Returns
    -------
    callable
        Takes the bytes of a stream, and returns an array with a row for each point: coordinates
        and, if the stream has them, colours and reflectance. It raises InputError if the program
        reports an error, and `CrashError` if the program crashes or does not end.

    Raises
    ------
    InputError
        The program does not exist.
    """
    if "{stream}" not in words:
        words = f"{shlex.quote(words)} --mode=1 --compressedStreamPath={{stream}}"
        words += " --reconstructedDataPath={points}"
    command = shlex.split(words)
    if shutil.which(command[0]) is None:
        raise InputError(f"no codec and no program '{command[0]}'")

    def decode(stream: bytes) -> Floats:
        with tempfile.TemporaryDirectory(prefix="puckbench-") as folder:
            source, target = Path(folder) / "stream.bin", Path(folder) / "points.ply"
            source.write_bytes(stream)
            filled = [
                word.replace("{stream}", str(source)).replace("{points}", str(target))
                for word in command
            ]
            _run(filled)
            cloud = read_cloud(target, keep_missing=True)
            values = [cloud.fields[name] for name in _REFLECTANCES if name in cloud.fields]
            return rows_of(cloud.xyz, cloud.colours, values[0] if values else None)

    return decode


def _run(command: list[str]) -> None:
    try:
        ran = subprocess.run(command, capture_output=True, check=False, timeout=SECONDS)
    except subprocess.TimeoutExpired as error:
        raise CrashError(f"did not end within {SECONDS} s") from error
    except OSError as error:
        raise InputError(f"{command[0]}: {error.strerror}") from error
    if ran.returncode < 0:
        raise CrashError(f"ended by signal {-ran.returncode}")
    if ran.returncode:
        said = (ran.stderr or ran.stdout).decode(errors="replace").strip()
        raise InputError(f"status {ran.returncode}: {said.rpartition(chr(10))[2][:80]}")
