"""Results that were copied, moved or replaced, and input files that were replaced."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest

from tests.support.bench import RAW_CODEC, Bench

SMALL: dict[str, Any] = {
    "scene_sets": {"files": {"loader": "point_clouds", "options": {"path": "clouds"}}},
    "datasets": {"mine": {"scene_set": "files", "make": "cloud"}},
    "codecs": {"raw_grid": {"class": "raw_grid.py:Raw", "rates": {"r1": {"step": 1.0}}}},
    "sensor_study": None,
    "figures": {},
}
OTHER = {"scene_sets.files.options": {"path": "clouds", "keep_missing": True}}
"""A change that makes everything again."""
ROWS = [f"results/metrics/mine/{cloud}/raw_grid.parquet" for cloud in "ab"]
ALL = {"scene": 2, "prepare": 2, "encode_raw_grid": 2, "evaluate_raw_grid": 2}
OF_ONE = dict.fromkeys(ALL, 1)


def write_cloud(path: Path, height: float, time: float | None = None) -> None:
    """Write twelve points, into a new file, as `unzip`, `cp -p` and `rsync -a` do."""
    new = path.with_name("new")
    new.write_text("".join(f"{k % 3} {k % 4} {height + k % 2}\n" for k in range(12)))
    if time is not None:
        os.utime(new, (time, time))
    new.replace(path)


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    """A folder with two clouds of which all curves were measured."""
    bench = Bench(tmp_path_factory.mktemp("original"))
    (bench.folder / "clouds").mkdir()
    for height, cloud in enumerate("ab", start=1):
        write_cloud(bench.folder / "clouds" / f"{cloud}.xyz", height)
    bench.configure(deepcopy(SMALL))
    bench.made(*ROWS)
    return bench


@pytest.fixture
def copied(original: Bench, tmp_path: Path) -> Bench:
    """A copy of that folder, without Snakemake's memory."""
    return original.copied(tmp_path / "copy")


def test_a_copy_that_agrees_is_up_to_date(copied: Bench) -> None:
    assert copied.planned(*ROWS) == {}


def test_results_that_were_moved_to_another_folder_are_up_to_date(copied: Bench) -> None:
    copied.results.rename(copied.folder / "elsewhere")
    copied.configure({**deepcopy(SMALL), "results": "elsewhere"})
    rows = [row.replace("results", "elsewhere") for row in ROWS]
    assert copied.planned(*rows) == {}


def test_a_copy_without_its_times_is_up_to_date_once_they_are_in_order(copied: Bench) -> None:
    """As the page says; this does not take results of other options for current."""
    for age, folder in enumerate(("coded", "scenes", "metrics", "clouds")):
        for path in (copied.results / folder).rglob("*.*"):
            os.utime(path, (1e9 - age, 1e9 - age))
    assert copied.planned(*ROWS) != {}
    done = copied.snakemake("--touch", *ROWS)
    assert done.returncode == 0, done.stderr[-4000:]
    assert copied.planned(*ROWS) == {}
    copied.configure({**deepcopy(SMALL), **OTHER})
    assert copied.snakemake("--touch", *ROWS).returncode == 0
    assert copied.planned(*ROWS) == ALL


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        (OTHER, ALL),
        ({"datasets.mine.size": 512}, {name: ALL[name] for name in ALL if name != "scene"}),
        (
            {"codecs.raw_grid.rates": {"r1": {"step": 2.0}}},
            {"encode_raw_grid": 2, "evaluate_raw_grid": 2},
        ),
        ({"timing": {"repeats": 1, "threads": 2}}, {"encode_raw_grid": 2, "evaluate_raw_grid": 2}),
        ({"metrics": ["density"]}, {"evaluate_raw_grid": 2}),
    ],
)
def test_a_copy_is_made_again_where_the_configuration_differs(
    copied: Bench, changes: dict[str, Any], expected: dict[str, int]
) -> None:
    copied.configure({**deepcopy(SMALL), **changes})
    assert copied.planned(*ROWS) == expected


def test_a_copy_is_made_again_where_the_code_differs(copied: Bench) -> None:
    (copied.folder / "raw_grid.py").write_text(RAW_CODEC.replace('"raw 1"', '"raw 2"'))
    assert copied.planned(*ROWS) == {"encode_raw_grid": 2, "evaluate_raw_grid": 2}


def test_results_that_replace_those_of_a_run_are_noticed(copied: Bench) -> None:
    """Snakemake remembers what this folder's configuration made, not what lies there now."""
    shutil.copytree(copied.results, copied.folder / "kept")
    copied.configure({**deepcopy(SMALL), **OTHER})
    copied.made(*ROWS)
    assert copied.planned(*ROWS) == {}
    shutil.rmtree(copied.results)
    (copied.folder / "kept").rename(copied.results)
    assert copied.planned(*ROWS) == ALL


def _without_logs(results: Path) -> None:
    shutil.rmtree(results / "logs")


def _of_an_earlier_version(results: Path) -> None:
    for log in (results / "logs").rglob("*.log"):
        log.write_text(re.sub(r'"key": "[^"]+", ', "", log.read_text()))


def _with_torn_logs(results: Path) -> None:
    for log in (results / "logs").rglob("*.log"):
        log.write_text(log.read_text()[:-9])


@pytest.mark.parametrize(
    "change", [_without_logs, _of_an_earlier_version, _with_torn_logs], ids=lambda c: c.__name__
)
def test_results_of_which_nobody_knows_how_they_were_made_are_made_again(
    copied: Bench, change: Callable[[Path], None]
) -> None:
    change(copied.results)
    assert copied.planned(*ROWS) == ALL
    said = copied.snakemake("--dry-run", *ROWS).stderr.splitlines()
    assert [line for line in said if line.startswith("puckbench: ")] == [
        "puckbench: results: no log says how results were made: all are made again"
    ]


def test_a_first_run_has_nothing_to_say_about_provenance(fresh: Bench) -> None:
    done = fresh.snakemake("--dry-run", "results/tables/table_4_1.csv")
    assert done.returncode == 0
    assert "puckbench: " not in done.stderr


@pytest.mark.parametrize("time", [1e9, None])
def test_a_replaced_cloud_is_coded_again_alone_whatever_its_time(
    copied: Bench, time: float | None
) -> None:
    cloud = copied.folder / "clouds" / "b.xyz"
    write_cloud(cloud, 5, cloud.stat().st_mtime if time is None else time)
    assert copied.planned(*ROWS) == OF_ONE
    copied.made(*ROWS)
    assert copied.planned(*ROWS) == {}
    write_cloud(cloud, 6, cloud.stat().st_mtime - 100)  # now with Snakemake's memory
    assert copied.planned(*ROWS) == OF_ONE


def test_a_newer_time_alone_re_runs_nothing(copied: Bench) -> None:
    os.utime(copied.folder / "clouds" / "a.xyz")
    assert copied.planned(*ROWS) == {}
