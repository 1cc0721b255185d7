"""Machine code is cached on disk, and not used when another file that it holds code of changes."""

import os
import subprocess
import sys
from pathlib import Path

SOURCE = Path(__file__).parents[2] / "src"
OUTER = """
from inner import inner
from puckbench.core.compiling import compiled

@compiled
def outer():
    return inner() + 1

print(outer(), outer.stats.cache_hits[()] if () in outer.stats.cache_hits else 0)
"""
INNER = """
from puckbench.core.compiling import compiled

@compiled
def inner():
    return {value}
"""


def _run(folder: Path) -> str:
    environment = {**os.environ, "PYTHONPATH": f"{SOURCE}:{folder}"}
    environment.pop("NUMBA_CACHE_DIR", None)
    done = subprocess.run(
        [sys.executable, folder / "outer.py"],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.strip()


def test_a_cached_function_follows_the_one_it_calls(tmp_path: Path) -> None:
    (tmp_path / "outer.py").write_text(OUTER)
    (tmp_path / "inner.py").write_text(INNER.format(value=1))
    assert _run(tmp_path) == "2 0"
    assert _run(tmp_path) == "2 1"
    (tmp_path / "inner.py").write_text(INNER.format(value=5))
    assert _run(tmp_path) == "6 0"


def test_functions_that_call_blas_are_compiled() -> None:
    program = (
        "import sys; from puckbench.core.compiling import compiled; import numba, numpy as np;"
        "print('scipy.linalg' in sys.modules);"
        "print(numba.njit(lambda a: a @ a)(np.eye(2) * 3)[1, 1])"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == ["False", "9.0"]
