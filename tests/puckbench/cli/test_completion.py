"""The scripts of `puckbench completion`, in the shells that are here."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from puckbench.cli import main
from puckbench.cli.registry import help_texts

LINES = {
    "puckbench dec": {"decode", "decompress"},
    "puckbench --ver": {"--version", "--verbose"},
    "puckbench encode --codec gpcc_a": {"gpcc_angular", "gpcc_arena"},
    "puckbench encode --fr": {"--frame"},
    "puckbench encode clo": {"cloud.ply"},
    "puckbench encode cloud.ply b.bin --prepare clo": {"cloud.ply"},
    "puckbench run --codecs gpcc_a": {"gpcc_angular", "gpcc_arena"},
    "puckbench run --out results clo": {"cloud.ply"},
    "puckbench run --study def": {"default"},
    "puckbench compare results --with def": {"default"},
    "puckbench data reno": {"reno_weights"},
    "puckbench scan room.ply out --errors vlp16_d": {"vlp16_divergence"},
    "puckbench scene embedded_o": {"embedded_objects"},
    "puckbench compress --effort f": {"fast"},
    "puckbench completion ": {"bash", "zsh", "fish"},
}

BASH = """
source completion
COMP_WORDS=({words})
COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1))
complete=$(complete -p puckbench | sed 's/.*-F \\([^ ]*\\).*/\\1/')
$complete puckbench "${{COMP_WORDS[-1]}}" "${{COMP_WORDS[-2]}}"
printf '%s\\n' "${{COMPREPLY[@]}}"
"""

FISH = 'source completion; complete -C "{words}" | cut -f1'


@pytest.fixture(params=["bash", "fish"])
def shell(request: pytest.FixtureRequest) -> str:
    """A shell that answers without a terminal."""
    if not shutil.which(request.param):
        pytest.skip(f"{request.param} is not installed")
    return str(request.param)


def _script(shell: str, capsys: pytest.CaptureFixture[str]) -> str:
    assert main(["completion", shell]) == 0
    return capsys.readouterr().out


def _said(folder: Path, *words: str) -> str:
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return done.stdout


def test_commands_options_names_and_files_are_completed(
    shell: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "completion").write_text(_script(shell, capsys))
    (tmp_path / "cloud.ply").touch()
    for line, expected in LINES.items():
        words = line if not line.endswith(" ") or shell == "fish" else f"{line}''"
        program = {"bash": BASH, "fish": FISH}[shell].format(words=words)
        assert set(_said(tmp_path, shell, "-c", program).split()) == expected, line


@pytest.mark.skipif(not shutil.which("zsh"), reason="zsh is not installed")
def test_zsh_loads_its_script_from_a_folder_of_functions(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "_puckbench").write_text(_script("zsh", capsys))
    load = "fpath=($PWD $fpath); autoload -Uz compinit; compinit -u -d dump"
    assert _said(tmp_path, "zsh", "-f", "-c", f"{load}; echo $_comps[puckbench]") == "_puckbench\n"
    _said(tmp_path, "zsh", "-n", "_puckbench")


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_every_command_is_in_every_script(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    script = _script(shell, capsys)
    assert [name for name in help_texts() if name not in script] == []
    assert "--error-options" in script or "error-options" in script
