"""Mutation testing: small changes of the code, each of which a test of its module has to notice.

    python -m benchmarks.checks.mutants [MODULE ...] [--each 20] [--seed 0]

A mutant changes a comparison, operator, number, truth value, condition or returned value. A sample
of each module's mutants is tested in a copy of the tree, with its own tests (`TESTS`). Prints
the mutants that survived; exit status 1 if they are a tenth or more.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import copy
import importlib
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
TREE = Path(tempfile.gettempdir()) / f"puckbench-mutants-{os.getuid()}"
COPIED = ("benchmarks", "config", "docs", "src", "tests", "workflow")
LIBRARIES = ["open3d", "trimesh", "pandas", "pyarrow.parquet", "numba", "hypothesis", "pydantic"]
LIBRARIES += ("scipy.interpolate", "scipy.spatial", "scipy.stats", "scipy.optimize", "pytest")
MOST_SURVIVORS = 0.1
ROOMS = (
    *("jenco2022/claims", "pointkit/lidar", "puck/recordings", "puckbench/metrics"),
    *("puckbench/recordings", "virtual_lidar"),
)
TESTS = {
    "cloud_files": "cloud_formats",
    "cloud_files/clouds": "clouds cloud_formats",
    "cloud_files/descriptions": "clouds hostile_descriptions",
    "cloud_files/las": "las cloud_formats",
    "cloud_files/meshes": "meshes meshes_text glb concave_faces",
    "cloud_files/npy": "cloud_formats damaged_files",
    "cloud_files/ply": "ply_header clouds meshes",
    "cloud_files/text": "cloud_formats damaged_files",
    "jenco2022/claims": "claim_rules claims",
    "pointkit/isolated": "isolated",
    "pointkit/lidar": "recordings turns sensor",
    "puckbench/geometry/extent": "units",
    "puckbench/geometry/neighbours": "neighbours geometry",
    "puckbench/metrics": "seen",
    "puckbench/metrics/geometry": "geometry truth",
    "puckbench/scene_sets/user_files": "units point_clouds",
    "puckbench/tables/rate_deltas": "bjontegaard",
    "puckbench/recordings": "recordings",
    "puckbench/recordings/writing": "recording_writing",
    "virtual_lidar/calibration": "calibration_parts calibration",
    "virtual_lidar/errors": "errors closed_forms calibrated",
    "virtual_lidar/errors/beam_footprint": "footprint rays",
    "virtual_lidar/errors/model": "errors receiver mirrors",
    "virtual_lidar/kernels": "rays scan footprint",
    "virtual_lidar/placement": "origin placement",
    "virtual_lidar/raycast": "rays scan trajectory",
    "virtual_lidar/scan": "scan trajectory mirrors",
    "virtual_lidar/scan_returns": "returns",
    "virtual_lidar/scan_table": "table scan",
    "virtual_lidar/walls": "ray_statistics wall_residuals",
    "virtual_lidar/walls/detection": "wall_detection",
    "virtual_lidar/walls/range_image": "wall_range_image",
}
"""Tests of modules, or of all in a folder, by their names, where no test is named as the module."""

_PAIRS = "Eq NotEq, Is IsNot, In NotIn, Add Sub, Mult Div, BitAnd BitOr, LShift RShift, And Or"
_TURNED = "Lt LtE, Lt GtE, LtE Lt, LtE Gt, Gt GtE, Gt LtE, GtE Gt, GtE Lt, FloorDiv Mult, Mod Mult"
SWAPS = [pair.split() for pair in f"{_PAIRS}, {_TURNED}, Pow Mult".split(", ")]
SWAPS += [pair[::-1] for pair in SWAPS[: _PAIRS.count(",") + 1]]
"""Operators by their names in `ast`, and what takes their place."""


def modules(beginnings: list[str]) -> dict[str, list[str]]:
    """Modules of the rooms, or those that begin so, and the paths of their tests.

    These are the tests that `TESTS` names for a module, else the test of the module's name, else
    the nearest of `TESTS`, else all of the package.
    """
    tests: dict[str, list[str]] = {}
    for path in sorted((ROOT / "tests").rglob("test_*.py")):
        tests.setdefault(path.stem.removeprefix("test_"), []).append(str(path.relative_to(ROOT)))
    named = {name: [path for stem in TESTS[name].split() for path in tests[stem]] for name in TESTS}
    found = {}
    for path in sorted((ROOT / "src").rglob("*.py")):
        name = str(path.relative_to(ROOT / "src").with_suffix(""))
        if f"{name}.py".startswith(tuple(beginnings or ROOMS)):
            package, *above = map(str, [*Path(name).parents][-2::-1])
            near = [named[each] for each in (package, *above) if each in named]
            own = [each for each in tests.get(path.stem, []) if f"/{package}/" in each]
            found[name] = named.get(name) or own or [[f"tests/{package}"], *near][-1]
    return found


def changed(node: ast.AST) -> Iterator[ast.AST]:
    """What may stand in a node's place: the operators of cosmic-ray, fewer of each."""
    if isinstance(node, (ast.BinOp, ast.BoolOp)):
        yield from (_with(node, op=other) for other in _others(node.op))
    elif isinstance(node, ast.Compare) and len(node.ops) == 1:
        yield from (_with(node, ops=[other]) for other in _others(node.ops[0]))
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.Not, ast.USub, ast.Invert)):
        yield node.operand
    elif isinstance(node, ast.Constant) and isinstance(node.value, bool):
        yield ast.Constant(not node.value)
    elif isinstance(node, ast.Constant) and isinstance(node.value, int):
        yield from (ast.Constant(node.value + 1), ast.Constant(node.value - 1))
    elif isinstance(node, ast.Constant) and isinstance(node.value, float):
        yield ast.Constant(node.value * 1.2 if node.value else 1.0)
    elif isinstance(node, (ast.If, ast.IfExp)) and not isinstance(node.test, ast.Compare):
        yield _with(node, test=ast.UnaryOp(ast.Not(), node.test))
    elif isinstance(node, ast.Return) and ast.unparse(node) not in {"return", "return None"}:
        yield ast.Return(ast.Constant(None))


def _others(operator: ast.AST) -> Iterator[ast.AST]:
    name = type(operator).__name__
    yield from (getattr(ast, other)() for own, other in SWAPS if own == name)


def _with(node: ast.AST, **fields: object) -> ast.AST:
    twin = copy.copy(node)
    for name, value in fields.items():
        setattr(twin, name, value)
    return twin


def places(node: ast.AST) -> Iterator[tuple[ast.AST, str, int | None]]:
    """Parent, field and index of every node, but in annotations, texts and `strict` of zip."""
    for name, value in ast.iter_fields(node):
        if name in {"annotation", "returns", "decorator_list"} or isinstance(node, ast.JoinedStr):
            continue
        if isinstance(node, ast.keyword) and node.arg == "strict":
            continue
        for index, child in enumerate(value if isinstance(value, list) else [value]):
            is_typing = isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING"
            if isinstance(child, ast.AST) and not is_typing:
                yield node, name, index if isinstance(value, list) else None
                yield from places(child)


def mutants(source: str) -> Iterator[tuple[str, str]]:
    """All mutants of a module: the line and the change, and the mutant's source."""
    tree = ast.parse(source)
    for parent, name, index in list(places(tree)):
        whole = getattr(parent, name)
        node = whole if index is None else whole[index]
        for other in changed(node):
            put = other if index is None else [*whole[:index], other, *whole[index + 1 :]]
            setattr(parent, name, put)
            head = [_head(ast.unparse(ast.fix_missing_locations(one))) for one in (node, other)]
            yield f"{node.lineno}: {' -> '.join(head)}", ast.unparse(tree)
            setattr(parent, name, whole)


def _head(text: str) -> str:
    return text.splitlines()[0][:80]


def tested(words: list[str], seconds: float) -> int | None:
    """Exit status of pytest in a fork of this process; None when it takes longer."""
    child = os.fork()
    if not child:
        os.setsid()
        quiet = os.open(os.devnull, os.O_RDWR)
        for stream in (0, 1, 2):
            os.dup2(quiet, stream)
        import pytest

        os._exit(int(pytest.main(["-x", "-p", "no:cacheprovider", *words])))
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if (ended := os.waitpid(child, os.WNOHANG))[0]:
            return os.waitstatus_to_exitcode(ended[1])
        time.sleep(0.02)
    os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return None


def campaign(module: str, tests: list[str], each: int, seed: int) -> tuple[int, int]:
    source = ROOT / "src" / f"{module}.py"
    place = TREE / source.relative_to(ROOT)
    words = [
        *tests,
        "--hypothesis-profile=mutants",
        "-W",
        "ignore::pytest.PytestAssertRewriteWarning",
    ]
    sys.dont_write_bytecode = False
    found = list(mutants(source.read_text()))
    drawn = random.Random(f"{seed} {module}").sample(found, min(each, len(found)))
    start = time.monotonic()
    if drawn and tested(words, 600) != 0:
        raise SystemExit(f"{module}: its tests fail before anything is changed")
    limit = 30 + 5 * (time.monotonic() - start)
    sys.dont_write_bytecode = True
    survived = 0
    for name, mutant in drawn:
        place.write_text(mutant)
        if tested(words, limit) == 0:
            survived += 1
            print(f"{module}.py:{name}", flush=True)
    shutil.copy2(source, place)
    share = survived / max(len(drawn), 1)
    print(f"{module:36}{len(found):8}{len(drawn):8}{survived:8}{share:8.0%}", flush=True)
    return len(drawn), survived


def prepare() -> None:
    """Copy the tree, and import what all tests import but our own packages."""
    shutil.rmtree(TREE, ignore_errors=True)
    for folder in COPIED:
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / folder, TREE / folder, ignore=ignored)
    shutil.copy2(ROOT / "pyproject.toml", TREE)
    os.chdir(TREE)
    sys.path[:0] = [str(TREE / "src"), str(TREE)]
    os.environ["PYTHONPATH"] = str(TREE / "src")
    for library in LIBRARIES:
        with contextlib.suppress(ImportError):
            importlib.import_module(library)
    from hypothesis import HealthCheck, Phase, settings

    checks = list(HealthCheck)
    phases = (Phase.explicit, Phase.generate)  # no search for the simplest failure
    settings.register_profile(
        "mutants", derandomize=True, deadline=None, phases=phases, suppress_health_check=checks
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("modules", nargs="*", help="places in src, or beginnings of them")
    parser.add_argument("--each", type=int, default=20, help="mutants of each module, at most")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    chosen = modules(options.modules)
    prepare()
    print(f"{'module':36}{'mutants':>8}{'tested':>8}{'survived':>8}", flush=True)
    counts = [campaign(*pair, options.each, options.seed) for pair in chosen.items()]
    total, survived = map(sum, zip(*counts, strict=True))
    print(f"{'all':36}{'':8}{total:8}{survived:8}{survived / total:8.0%}")
    sys.exit(survived >= MOST_SURVIVORS * total)


if __name__ == "__main__":
    main()
