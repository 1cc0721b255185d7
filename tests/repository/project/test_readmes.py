"""The examples in the README of each package run as they are, one after the other."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[3] / "src"
PACKAGES = sorted(path.parent.name for path in SOURCE.glob("*/pyproject.toml"))


def python_blocks(package: str) -> str:
    """The Python blocks of a package's README, as one program."""
    readme = (SOURCE / package / "README.md").read_text()
    return "\n".join(re.findall(r"^```python\n(.*?)^```", readme, re.DOTALL | re.MULTILINE))


@pytest.mark.parametrize("package", PACKAGES)
def test_the_python_blocks_run_one_after_the_other(package: str, tmp_path: Path) -> None:
    program = tmp_path / "program.py"  # numba keeps compiled loops beside a file
    program.write_text(python_blocks(package))
    assert program.read_text()
    done = subprocess.run(
        [sys.executable, "-W", "error", program],
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
        timeout=900,
    )
    assert done.returncode == 0, done.stderr
