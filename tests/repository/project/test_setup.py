"""The pins in envs/ cover what the packages need, and the script says what a bare system lacks."""

import importlib.metadata
import runpy
import shutil
import subprocess
from collections.abc import Iterable
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[3]
ENVS = ROOT / "envs"
REQUIREMENTS = runpy.run_path(str(ENVS / "lock.py"))["requirements"]
LOCKS = {  # extra or group: the files that hold its packages
    "": ["requirements.lock"],
    "odometry": ["requirements.lock", "odometry.lock"],
    "test": ["requirements.lock", "odometry.lock", "test.lock"],
    "learned": ["requirements.lock", "learned.lock"],
    "slurm": ["requirements.lock", "slurm.lock"],
    "docs": ["requirements.lock", "odometry.lock", "test.lock", "docs.lock"],
}
SYSTEMS = [
    {"python_version": python, "sys_platform": system, "platform_machine": machine}
    for python in ("3.11", "3.12", "3.13", "3.14")
    for system, machine in (("linux", "x86_64"), ("linux", "aarch64"), ("darwin", "arm64"))
]


def pins_of(*names: str) -> list[Requirement]:
    lines = [line for name in names for line in (ENVS / name).read_text().splitlines()]
    return [Requirement(line) for line in lines if line[:1].isalnum()]


def on_system(requirements: Iterable[Requirement], system: dict[str, str]) -> list[Requirement]:
    full = {**system, "python_full_version": system["python_version"] + ".0", "extra": ""}
    return [r for r in requirements if r.marker is None or r.marker.evaluate(full)]


def version_of(pin: Requirement) -> str:
    (specifier,) = pin.specifier
    assert specifier.operator == "=="
    return specifier.version


def versions_on(pins: Iterable[Requirement], system: dict[str, str]) -> dict[str, str]:
    return {canonicalize_name(pin.name): version_of(pin) for pin in on_system(pins, system)}


@pytest.mark.parametrize("system", SYSTEMS, ids=lambda s: "-".join(s.values()))
@pytest.mark.parametrize("extra", LOCKS)
def test_locks_satisfy_every_requirement_on_every_system(
    extra: str, system: dict[str, str]
) -> None:
    expected = list(map(Requirement, REQUIREMENTS(extra)))
    assert expected
    pinned = versions_on(pins_of(*LOCKS[extra]), system)
    for requirement in on_system(expected, system):
        assert requirement.specifier.contains(pinned[canonicalize_name(requirement.name)])


def requirements_of(package: str) -> list[str]:
    result = map(Requirement, importlib.metadata.requires(package) or [])
    needed = [r for r in result if r.marker is None or r.marker.evaluate({"extra": ""})]
    return [canonicalize_name(r.name) for r in needed]


def test_lock_holds_all_that_the_installed_packages_need() -> None:
    pinned = {canonicalize_name(pin.name) for pin in pins_of("requirements.lock")}
    ours = {canonicalize_name(path.parent.name) for path in ROOT.glob("src/*/pyproject.toml")}
    needed, seen = ["puckbench"], set[str]()
    while needed:
        package = needed.pop()
        if package not in seen:
            seen.add(package)
            needed += requirements_of(package)
    assert "numpy" in seen
    assert "gpcc" in seen
    assert seen - ours <= pinned


def test_no_package_is_pinned_in_two_locks() -> None:
    locks = sorted(path.name for path in ENVS.glob("*.lock"))
    for system in SYSTEMS:
        names = [pin.name for pin in on_system(pins_of(*locks), system)]
        assert sorted(set(names)) == sorted(names)


def test_torch_brings_cuda_only_as_a_constraint() -> None:
    assert "--constraint cuda.constraints" in (ENVS / "learned.lock").read_text().splitlines()
    assert not [pin for pin in pins_of("learned.lock") if pin.name.startswith(("nvidia", "cuda"))]


def test_conda_environment_is_in_step_with_the_lock() -> None:
    environment = yaml.safe_load((ENVS / "puckbench.yaml").read_text())
    (pip,) = [entry["pip"] for entry in environment["dependencies"] if isinstance(entry, dict)]
    assert [Requirement(line) for line in pip] == pins_of(
        "requirements.lock", "learned.lock", "odometry.lock"
    )


def test_no_file_names_a_registry() -> None:
    for path in ENVS.iterdir():
        assert path.is_dir() or "://" not in path.read_text(), path


def test_locks_leave_the_choice_of_index_to_the_installer() -> None:
    lines = [line for path in ENVS.glob("*.lock") for line in path.read_text().splitlines()]
    options = {line for line in lines if line.startswith("-")}
    assert options == {"--constraint cuda.constraints"}


@pytest.mark.parametrize(
    ("absent", "packages"),
    [([], []), (["libGL.so.1"], ["libgl1"]), (["libusb-1.0.so.0"], ["libusb-1.0-0"])],
)
def test_missing_library_is_named_by_its_package(absent: list[str], packages: list[str]) -> None:
    def load(name: str) -> None:
        if name in absent:
            raise OSError(name)

    missing = runpy.run_path(str(ENVS / "system_packages.py"))["missing_libraries"](load)
    assert list(missing.values()) == packages


def bare_system(folder: Path, **programs: str) -> Path:
    """A folder for PATH: basic tools, an ordinary user, and the given programs as scripts."""
    for tool in ("cat", "cut", "dirname", "env", "grep", "paste", "sh", "tr"):
        (folder / tool).symlink_to(str(shutil.which(tool)))
    for name, body in ({"id": "echo 1000"} | programs).items():
        (folder / name).write_text(f"#!/bin/sh\n{body}\n")
        (folder / name).chmod(0o755)
    return folder


def set_up(
    path: Path, root: Path, *groups: str, **environment: str
) -> subprocess.CompletedProcess[str]:
    shutil.copytree(ENVS, root / "envs")
    return subprocess.run(
        [root / "envs" / "setup.sh", *groups],
        env={"PATH": str(path), **environment},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.fixture
def bin_folder(tmp_path: Path) -> Path:
    folder = tmp_path / "bin"
    folder.mkdir()
    return folder


def assert_says(done: subprocess.CompletedProcess[str], *words: str) -> None:
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    for word in words:
        assert word in line


def test_without_python_or_rights_it_names_the_packages(tmp_path: Path, bin_folder: Path) -> None:
    path = bare_system(bin_folder, **{"apt-get": "echo called >&2"})
    assert_says(set_up(path, tmp_path), "Python 3.11", "sudo apt-get install", "-venv")


def test_an_older_python_is_not_taken(tmp_path: Path, bin_folder: Path) -> None:
    path = bare_system(bin_folder, python3="exit 1")
    assert_says(set_up(path, tmp_path), "Python 3.11")


def test_a_wrong_python_variable_is_named(tmp_path: Path, bin_folder: Path) -> None:
    path = bare_system(bin_folder)
    assert_says(set_up(path, tmp_path, PYTHON="python2.7"), "PYTHON=python2.7")


@pytest.mark.parametrize(
    ("programs", "words"),
    [
        ({"apt-get": "echo called >&2"}, ["sudo apt-get install --yes libegl1 libgl1"]),
        ({"apt-get": "echo called >&2", "sudo": "exit 1"}, ["libegl1 libgl1"]),
        ({}, ["libEGL.so.1 libGL.so.1"]),
    ],
    ids=["no sudo", "sudo with password", "no apt"],
)
def test_missing_libraries_stop_an_ordinary_user_before_anything_is_installed(
    tmp_path: Path, bin_folder: Path, programs: dict[str, str], words: list[str]
) -> None:
    libraries = "*--libraries) echo libEGL.so.1 libGL.so.1;;"
    python = f'case "$*" in {libraries} envs/*) echo libegl1 libgl1;; esac'
    path = bare_system(bin_folder, python3=python, **programs)
    assert_says(set_up(path, tmp_path), *words)
    assert not (tmp_path / ".venv").exists()


@pytest.mark.parametrize("programs", [{}, {"apt-get": "echo called >&2"}], ids=["no apt", "apt"])
def test_a_missing_browser_is_named_before_the_tests_tools_are_installed(
    tmp_path: Path, bin_folder: Path, programs: dict[str, str]
) -> None:
    path = bare_system(bin_folder, python3="exit 0", **programs)
    words = ["Chromium", "CHROMIUM="]
    words += ["sudo apt-get install --yes chromium"] if programs else []
    assert_says(set_up(path, tmp_path, "test"), *words)
    assert not (tmp_path / ".venv").exists()


def test_a_browser_that_the_variable_names_is_enough(tmp_path: Path, bin_folder: Path) -> None:
    stop = "echo stopped >&2; exit 2"
    path = bare_system(bin_folder, python3="exit 0", mine="exit 0", rsync="exit 0", rm=stop)
    done = set_up(path, tmp_path, "test", CHROMIUM="mine")
    assert "Chromium" not in done.stderr
    assert "stopped" in done.stderr
