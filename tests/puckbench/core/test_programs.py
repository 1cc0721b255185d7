"""External programs end with the process that runs them."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

RUNS = """
from puckbench.core.programs import run_program
run_program(["sh", "-c", "echo $$ > number; exec sleep 600"], 2**30, 600)
"""


@pytest.mark.parametrize("sent", [signal.SIGKILL, signal.SIGINT])
def test_a_program_ends_with_the_process_that_runs_it(sent: signal.Signals, tmp_path: Path) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", RUNS],
        cwd=tmp_path,
        stderr=subprocess.DEVNULL,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # noqa: PLW1509
    )
    number = tmp_path / "number"
    while not (number.exists() and number.read_text()):
        time.sleep(0.05)
    program = Path("/proc", number.read_text().strip())
    assert program.exists()
    os.kill(process.pid, sent)
    process.wait()
    while program.exists():
        time.sleep(0.05)
