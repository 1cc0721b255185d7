"""What a result row says of the machine that it was timed on, and the table of machines."""

import json
import os
import subprocess
import sys

import pandas as pd
import pytest

from puckbench.core.environment import (
    THREAD_VARIABLES,
    allowed_threads,
    libraries,
    run_environment,
    thread_environment,
)
from puckbench.tables.machines import machines


def test_the_environment_of_a_timed_job_gives_every_library_its_threads() -> None:
    program = (
        "import json, numba, torch; from pointkit.threads import allowed_threads;"
        "print(json.dumps([numba.get_num_threads(), torch.get_num_threads(), allowed_threads()]))"
    )
    environment = {**os.environ, **thread_environment(1)}
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert json.loads(done.stdout) == [1, 1, 1]


def test_without_a_number_the_threads_are_the_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in THREAD_VARIABLES:
        monkeypatch.delenv(name, raising=False)
    assert allowed_threads() == len(os.sched_getaffinity(0))
    monkeypatch.setenv("OMP_NUM_THREADS", "3,2")
    assert allowed_threads() == 3


def test_a_row_names_processor_and_versions() -> None:
    result = run_environment(alone=True)
    assert result["cpu"]
    assert result["timed_alone"] is True
    assert f"numpy {__import__('numpy').__version__}" in libraries()
    assert libraries().startswith(f"python {sys.version_info.major}.{sys.version_info.minor}")


def test_results_of_two_machines_are_two_rows() -> None:
    rows = [
        {"cpu": cpu, "threads": 1, "timed_alone": True, "codec_version": version}
        for cpu, version in (("A", "gpcc 1"), ("A", "draco 2"), ("B", "draco 2"))
    ]
    result = machines(pd.DataFrame(rows)).set_index("cpu")
    assert result["results"].to_dict() == {"A": 2, "B": 1}
    assert result["codec_versions"].to_dict() == {"A": "draco 2, gpcc 1", "B": "draco 2"}
