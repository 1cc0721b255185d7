"""Importing the package is fast, and loads no large library before the first use."""

import subprocess
import sys

import pytest

HEAVY = {"numba", "open3d", "pandas", "pyarrow", "pydantic", "scipy", "torch"}
MOST_SECONDS = 0.3

_IMPORT = """
import sys, time
before = time.process_time()
import gpcc
print(time.process_time() - before, *sys.modules)
"""


def _imported(code: str) -> tuple[float, set[str]]:
    """Seconds of the import in a fresh interpreter, and the modules that are loaded after it."""
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    seconds, *modules = run.stdout.split()
    return float(seconds), set(modules)


def test_an_import_takes_less_than_a_third_of_a_second() -> None:
    assert min(_imported(_IMPORT)[0] for _ in range(3)) < MOST_SECONDS


@pytest.mark.parametrize("use", ["", "dir(gpcc); gpcc.__all__", "gpcc.__doc__"])
def test_an_import_loads_no_large_library(use: str) -> None:
    _, modules = _imported(_IMPORT.replace("print", f"{use}\nprint"))
    assert HEAVY & modules == set()


def test_no_use_of_the_package_loads_a_library_that_it_does_not_depend_on() -> None:
    use = """
import numpy as np
points = np.arange(30).reshape(10, 3)
gpcc.decode_cloud(gpcc.encode_cloud(points, {"reflectance": np.arange(10)}))
gpcc.decode_geometry(gpcc.encode_predictive_geometry(points))
"""
    _, modules = _imported(_IMPORT.replace("print", f"{use}\nprint"))
    assert {"open3d", "pandas", "pyarrow", "torch"} & modules == set()
