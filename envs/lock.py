"""Writes the locks and the conda environment, for maintainers: ``make lock``.

The packages of src/ say what they need, each in its pyproject.toml, and the repository's
pyproject.toml what the checks and the documentation need. Pins stay as they are unless these files
forbid them; ``--upgrade`` takes the newest versions.
Needs uv on PATH. One resolution covers all supported Pythons and platforms, with one version of a
package wherever one serves them all, so that results do not depend on the Python.
"""

import re
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterable
from pathlib import Path

ENVS = Path(__file__).resolve().parent
ROOT = ENVS.parent
CUDA = ("cuda-", "nvidia-", "triton==")
COMPILE = "uv pip compile --quiet --universal --python-version 3.11 --fork-strategy fewest"
PLAIN = "--no-emit-index-url --no-header --no-annotate"
CONDA = ["python=3.11", "pip", "libegl", "libgl", "libidn2", "libusb", "xorg-libx11"]
WITH_TORCH = {"lidar_segmentation", "pcc_networks"}

Pins = list[str]  # such as "colorama==0.4.6 ; sys_platform == 'win32'"


def read_pins(path: Path) -> Pins:
    """Return the lines of a lock that pin a version."""
    return [line for line in path.read_text().splitlines() if line[:1].isalnum()]


def requirements(*extras: str) -> list[str]:
    """Return what the packages need with these extras and groups, each other left out.

    What needs PyTorch (`WITH_TORCH`) counts only with the extra "learned".
    """
    text = {path.parent.name: path.read_text() for path in ROOT.glob("src/*/pyproject.toml")}
    groups = tomllib.loads((ROOT / "pyproject.toml").read_text())["dependency-groups"]
    result = [line for extra in extras for line in groups.get(extra, [])]
    for name in text.keys() - (set() if "learned" in extras else WITH_TORCH):
        package = tomllib.loads(text[name])
        result += package["build-system"]["requires"] + package["project"]["dependencies"]
        optional = package["project"].get("optional-dependencies", {})
        result += [line for extra in ("tables", *extras) for line in optional.get(extra, [])]
    return sorted({line for line in result if normal_name(line) not in map(normal_name, text)})


def normal_name(requirement: str) -> str:
    """Return the name of the package that a requirement asks for, in the one form of any name."""
    return re.match(r"[\w.-]*", requirement)[0].lower().replace("_", "-")  # type: ignore[index]


def resolve(extras: list[str], preferred: Pins, obeyed: Pins, upgrade: bool = False) -> Pins:
    """Resolve the requirements with extras; ``preferred`` versions yield, ``obeyed`` do not."""
    with tempfile.TemporaryDirectory() as folder:
        out, constraints = Path(folder, "out"), Path(folder, "constraints")
        out.write_text("\n".join(preferred))
        constraints.write_text("\n".join(obeyed))
        command = [*COMPILE.split(), *PLAIN.split(), *(["--upgrade"] if upgrade else [])]
        command += [f"--constraint={constraints}", f"--output-file={out}", "-"]
        wanted = "\n".join(requirements(*extras))
        subprocess.run(command, input=wanted, text=True, check=True, cwd=ROOT)
        return read_pins(out)


def name_set(pins: Iterable[str]) -> set[str]:
    """Return the names of pinned packages."""
    return {pin.partition("==")[0] for pin in pins}


def write_lines(name: str, about: str, lines: list[str]) -> None:
    """Write one file of envs/."""
    text = "\n".join(["# Written by `make lock`; do not edit.", f"# {about}", *lines])
    (ENVS / name).write_text(text + "\n")


def conda_environment(pins: Pins) -> list[str]:
    """Return the lines of a conda environment with these versions and Open3D's system libraries."""
    lines = ["channels:", "  - conda-forge", "  - nodefaults", "dependencies:"]
    lines += [f"  - {package}" for package in CONDA]
    return [*lines, "  - pip:", *(f'      - "{pin}"' for pin in pins)]


def main() -> None:
    """Resolve everything at once, then split it by what needs it."""
    old = [pin for path in sorted(ENVS.glob("*.lock")) for pin in read_pins(path)]
    old += read_pins(ENVS / "cuda.constraints")
    pins = resolve(
        ["test", "learned", "odometry", "slurm", "docs"], old, [], upgrade="--upgrade" in sys.argv
    )
    run = resolve([], pins, pins)
    learned = [pin for pin in resolve(["learned"], pins, pins) if pin not in run]
    needed = name_set(pin for pin in resolve(["odometry"], pins, pins) if pin not in run)
    both = [pin for pin in resolve(["odometry", "test"], pins, pins) if pin not in run]
    odometry = [pin for pin in both if name_set([pin]) <= needed]
    test = [pin for pin in both if pin not in odometry]
    slurm = [pin for pin in resolve(["slurm"], pins, pins) if pin not in run]
    others = name_set([*run, *both])
    docs = [pin for pin in resolve(["docs"], pins, pins) if not name_set([pin]) <= others]
    cuda = [pin for pin in learned if pin.startswith(CUDA)]
    torch = ["--constraint cuda.constraints", *(pin for pin in learned if pin not in cuda)]
    write_lines("requirements.lock", "What a run needs.", run)
    about = "What tasks of robots need on top of requirements.lock."
    write_lines("odometry.lock", about, odometry)
    about = "What the checks need on top of requirements.lock and odometry.lock."
    write_lines("test.lock", about, test)
    about = "What runs on a Slurm cluster need on top of requirements.lock."
    write_lines("slurm.lock", about, slurm)
    write_lines("learned.lock", "What learned codecs need on top of requirements.lock.", torch)
    write_lines("cuda.constraints", "Versions for a torch that asks for CUDA; forces none.", cuda)
    about = "What building the documentation needs on top of test.lock."
    write_lines("docs.lock", about, docs)
    about = "The environment of the rules for --software-deployment-method conda."
    write_lines("puckbench.yaml", about, conda_environment([*run, *torch[1:], *odometry]))


if __name__ == "__main__":
    main()
