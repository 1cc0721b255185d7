from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from subprocess import PIPE
from typing import Any

from pointkit.errors import InputError
from pointkit.measurement import Cost
from puckbench.core import launch

_MAX_WORDS = 80
"""Maximum number of characters that an error message repeats of a program's last line."""


def run_program(
    command: Sequence[str | Path], memory_bytes: float, seconds: float
) -> tuple[Cost, str]:
    """Run a program under limits, and wait for its end; it is killed if this process ends first.

    Parameters
    ----------
    command
        Program and arguments.
    memory_bytes, seconds
        Limits of the program's address space, in bytes, and of its run time, in s.

    Returns
    -------
    tuple[Cost, str]
        Time and peak memory of the program, and the text that it printed.

    Raises
    ------
    InputError
        The program fails or exceeds a limit. The message ends with the last line of its output.
    """
    limits = (str(int(memory_bytes)), str(int(seconds)))
    words = [sys.executable, "-I", "-S", launch.__file__, *limits, *map(str, command)]
    pipe, held = os.pipe()
    with (
        subprocess.Popen(words, stdin=pipe, stdout=PIPE, stderr=PIPE) as process,
        os.fdopen(held, "wb"),
    ):
        os.close(pipe)
        cost, lines = process.communicate()
    output = lines.decode(errors="replace").strip()
    end: dict[str, Any] = json.loads(cost) if process.returncode == 0 else {"status": "not started"}
    if end["status"] != 0:
        last_line = output.rpartition("\n")[2][:_MAX_WORDS]
        raise InputError(f"{Path(command[0]).name} failed ({end['status']}: {last_line})")
    return Cost(end["seconds"], end["peak_kib"] / 1024), output
