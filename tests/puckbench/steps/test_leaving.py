"""How the process of a job ends."""

from __future__ import annotations

import subprocess
import sys


def test_a_job_s_process_ends_with_its_status_and_all_that_it_said() -> None:
    program = """
import atexit
from puckbench.steps.process import leave
atexit.register(print, "taken apart")
print("done")
leave(3)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, check=False)
    assert (done.returncode, done.stdout) == (3, b"done\n")
