"""The examples in the README of each package run as they are, one after the other."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

READMES = sorted((Path(__file__).parents[3] / "src").glob("*/README.md"))


@pytest.mark.parametrize("readme", READMES, ids=lambda path: path.parent.name)
def test_the_python_blocks_run_one_after_the_other(readme: Path, tmp_path: Path) -> None:
    blocks = re.findall(r"^```python\n(.*?)^```", readme.read_text(), re.DOTALL | re.MULTILINE)
    assert blocks
    program = tmp_path / "program.py"  # numba keeps compiled loops beside a file
    program.write_text("\n".join(blocks))
    done = subprocess.run(
        [sys.executable, "-W", "error", program],
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
        timeout=900,
    )
    assert done.returncode == 0, done.stderr
