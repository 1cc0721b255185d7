"""Each package of src/ declares all that it is made of and imports, and is imported quickly."""

import re
import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions, version
from pathlib import Path

import grimp
import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

SOURCE = Path(__file__).parents[3] / "src"
PROJECTS = {
    path.parent.name: tomllib.loads(path.read_text())
    for path in sorted(SOURCE.glob("*/pyproject.toml"))
}
LIGHT = (
    *("cloud_files", "gpcc", "lidar_segmentation", "pcc_networks", "pointkit", "primitive_codec"),
    *("puck", "puckbench"),
)
"""Packages that import nothing heavy before a name of theirs is used."""
HEAVY = {"numba", "scipy", "torch", "open3d", "pandas", "matplotlib"}
NOT_IMPORTED = {
    "jenco2022": "plug-ins",
    "snakemake": "is started as a program",
    "snakemake-executor-plugin-slurm": "Snakemake's option --executor slurm",
}
"""Declared packages that no module is seen to import."""


def printed(program: str, *words: str) -> list[str]:
    command = [sys.executable, "-c", program, *words]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()


def modules(project: str) -> list[str]:
    """The packages and subpackages that a project declares."""
    return list(PROJECTS[project]["tool"]["setuptools"]["packages"])


def roots(project: str) -> list[str]:
    return [name for name in modules(project) if "." not in name]


def test_all_subpackages_are_declared() -> None:
    folders = [path.parent.relative_to(SOURCE) for path in SOURCE.rglob("__init__.py")]
    declared = [name for project in PROJECTS for name in modules(project)]
    assert sorted(".".join(folder.parts) for folder in folders) == sorted(declared)


def requirements(package: str) -> list[Requirement]:
    """What a package declares, with all its extras, as far as it is for this system."""
    project = PROJECTS[package]["project"]
    lines = list(project["dependencies"])
    for extra in project.get("optional-dependencies", {}).values():
        lines += extra
    return [each for each in map(Requirement, lines) if not each.marker or each.marker.evaluate()]


@pytest.mark.parametrize("package", PROJECTS)
def test_the_packages_have_one_version_and_ask_for_it(package: str) -> None:
    number = PROJECTS["puckbench"]["project"]["version"]
    assert PROJECTS[package]["project"]["version"] == number == version(package)
    ours = [each for each in requirements(package) if each.name.replace("-", "_") in PROJECTS]
    assert {str(each.specifier) for each in ours} <= {f"=={number}"}


@pytest.mark.parametrize("package", PROJECTS)
def test_a_package_declares_what_its_modules_import(package: str) -> None:
    graph = grimp.build_graph(
        *roots(package),
        include_external_packages=True,
        exclude_type_checking_imports=False,
        cache_dir=None,
    )
    names = {name for name in graph.modules if "." not in name} - set(roots(package))
    providers = packages_distributions()
    imported = {
        frozenset(map(canonicalize_name, providers[name])) for name in names if name in providers
    }
    declared = {canonicalize_name(each.name) for each in requirements(package)}
    unknown = [sorted(each) for each in imported if not each & declared]
    known = {canonicalize_name(name) for each in providers.values() for name in each}
    idle = declared & known - {name for each in imported for name in each} - NOT_IMPORTED.keys()
    assert (unknown, idle) == ([], set())


def allowed(package: str) -> set[str]:
    """The packages of src/ that one may import, directly or not, itself too."""
    named = {each.name for each in requirements(package)} & PROJECTS.keys() - {"jenco2022"}
    return {package}.union(*map(allowed, named))


@pytest.fixture(scope="module")
def graph() -> grimp.ImportGraph:
    return grimp.build_graph("tests", *PROJECTS, exclude_type_checking_imports=True, cache_dir=None)


@pytest.mark.parametrize("package", PROJECTS)
def test_the_tests_of_a_package_import_only_what_it_depends_on(
    package: str, graph: grimp.ImportGraph
) -> None:
    chains = [
        " > ".join(chain)
        for other in PROJECTS.keys() - allowed(package)
        for chain in graph.find_shortest_chains(f"tests.{package}", other)
    ]
    assert sorted(chains) == []


def test_the_page_about_the_architecture_names_the_rooms_in_the_order_of_imports() -> None:
    contracts = tomllib.loads((SOURCE.parent / "pyproject.toml").read_text())
    (rooms,) = [
        each["layers"]
        for each in contracts["tool"]["importlinter"]["contracts"]
        if each.get("containers") == ["puckbench"]
    ]
    text = (SOURCE.parent / "docs" / "explanation" / "architecture.md").read_text()
    named = re.findall(r"^\| `(\w+)` \|", text, re.MULTILINE)
    assert named == [room for room in rooms if room != "__main__"]


PUBLIC_NAMES = """
import importlib, sys, typing
package = importlib.import_module(sys.argv[1])
public = {name: getattr(package, name) for name in package.__all__}
before = set(vars(package)) - public.keys()
typing.TYPE_CHECKING = True
seen = vars(importlib.reload(package))
print(all(seen[name] is public[name] for name in public), *(seen.keys() - before - public.keys()))
"""


@pytest.mark.parametrize("package", LIGHT)
def test_the_public_names_are_those_that_type_checkers_see(package: str) -> None:
    assert printed(PUBLIC_NAMES, package) == ["True"]


@pytest.mark.parametrize("package", LIGHT)
def test_importing_a_package_imports_nothing_heavy(package: str) -> None:
    program = "import importlib, sys; importlib.import_module(sys.argv[1]); print(*sys.modules)"
    assert HEAVY & set(printed(program, package)) == set()


def test_importing_gpcc_takes_less_than_a_third_of_a_second() -> None:
    """In processor time, since other processes may use the machine."""
    program = (
        "import time; start = time.process_time(); import gpcc; print(time.process_time() - start)"
    )
    assert min(float(printed(program)[0]) for _ in range(3)) < 0.3
