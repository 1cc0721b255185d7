"""The examples of the README and of the how-to guides do what these say."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from cloud_files.clouds import write_cloud
from pointkit.geometry.cloud import PointCloud
from pointkit.measurement import Cost
from pointkit.registry import trust
from puckbench.cli import main
from puckbench.codecs.coding import cost_of
from puckbench.codecs.registry import open_codec
from tests.support.bench import BOX, CONFIG, ROOT, Bench
from tests.support.codecs import decode, encode
from tests.support.pages import blocks, commands, page, write_files

CODEC = "docs/how-to/bring_a_codec.md"
COMPARE = "docs/how-to/compare.md"
DATA = "docs/how-to/bring_data.md"
LIBRARY = "docs/how-to/use_as_a_library.md"
ONE_RESULT = "docs/how-to/make_one_result.md"
THESIS = "docs/how-to/reproduce_the_thesis.md"


def _python(folder: Path, *words: str) -> str:
    """What a Python program in a folder prints, with puckbench on its path."""
    done = subprocess.run(
        [sys.executable, *words],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT / "src")},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_library_compares_codecs_as_its_page_shows(tmp_path: Path) -> None:
    write_files(tmp_path, CODEC, LIBRARY)
    rng = np.random.default_rng(0)
    np.savetxt(tmp_path / "points.xyz", rng.random((500, 3)) * [1, 1, 0.01])
    lines = _python(tmp_path, "compare.py").splitlines()
    table = pd.DataFrame([line.split()[1:] for line in lines[1:]], columns=lines[0].split())
    assert list(table.codec) == ["draco"] * 8 + ["grid"] * 4
    grid = table[table.codec == "grid"].astype({"bpp": float, "d1_psnr": float})
    assert grid.bpp.is_monotonic_increasing
    # Rounding to steps of 2 errs by 2**2 / 12 along each of three axes; MPEG's peak is tripled.
    assert grid.d1_psnr.iloc[-1] == pytest.approx(10 * np.log10(3 * 1023**2 / 1), abs=0.3)


def test_a_codec_that_runs_a_program_codes_as_its_page_shows(tmp_path: Path) -> None:
    write_files(tmp_path, CODEC)
    place = f"{tmp_path}/codecs/zipped.py:Zipped"
    trust([place])
    codec = open_codec("zipped", {"class": place})
    points = np.random.default_rng(0).random((500, 3)).astype(np.float32).astype(float)
    np.testing.assert_array_equal(decode(codec, encode(codec, points, "r2")), points)
    np.testing.assert_allclose(decode(codec, encode(codec, points, "r1")), points, atol=1e-3)
    assert cost_of(codec, Cost(0.0, 0.0)).seconds > 0


@pytest.mark.parametrize("place", ["codecs/grid.py:Grid", "codecs/zipped.py:Zipped"])
def test_the_codecs_of_its_page_pass_the_checks(
    place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write_files(tmp_path, CODEC)
    monkeypatch.chdir(tmp_path)
    assert main(["check", place]) == 0, capsys.readouterr().out


def test_gpcc_codes_points_alone_as_its_example_shows() -> None:
    points = np.random.default_rng(0).integers(0, 64, (200, 3))
    code = next(block for block in blocks(LIBRARY, "python") if "encode_geometry" in block)
    names = {"points": points}
    exec(code, names)  # noqa: S102 (our own page)
    decoded = eval("decode_geometry(stream).points", names)  # noqa: S307
    assert set(map(tuple, decoded)) == set(map(tuple, points))


def test_a_codec_of_ones_own_runs_as_its_page_shows(fresh: Bench) -> None:
    write_files(fresh.folder, CODEC)
    codecs = yaml.safe_load(blocks(CODEC, "yaml")[0])["codecs"]
    fresh.configure(
        {
            "datasets": {"objects": CONFIG["datasets"]["objects"]},
            "codecs": {"grid": codecs["grid"]},
            "figures": {},
            "sensor_study": None,
        }
    )
    fresh.made("tables")
    table = pd.read_csv(fresh.results / "tables" / "metrics.csv").set_index("rate")
    assert list(table.index) == ["r1", "r2", "r3", "r4"]
    assert table.bpp.is_monotonic_increasing
    assert table.d1_mse.is_monotonic_decreasing


def _shell(folder: Path, steps: str) -> str:
    """What the commands of a page print in a folder; each has to succeed."""
    bin_folder = Path(sys.executable).parent
    done = subprocess.run(
        ["bash", "-e", "-c", steps],
        cwd=folder,
        env={
            **os.environ,
            "PYTHONPATH": str(ROOT / "src"),
            "PATH": f"{bin_folder}{os.pathsep}{os.environ['PATH']}",
        },
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-4000:]
    return done.stdout


def test_the_codec_of_its_page_is_compared_with_published_results(tmp_path: Path) -> None:
    write_files(tmp_path, CODEC)
    printed = _shell(tmp_path, blocks(COMPARE, "sh")[0])
    assert re.search(r"^grid +0\.\d+ to \d", printed, re.MULTILINE), printed
    assert re.search(r"^grid against Draco .*%", printed, re.MULTILINE)
    assert (tmp_path / "out" / "report.html").exists()
    assert len(pd.read_csv(tmp_path / "out" / "tables" / "metrics.csv")) == 6 * 4
    assert (tmp_path / "out" / "comparison" / "default.pdf").exists()


def test_files_of_ones_own_run_as_the_pages_show(tmp_path: Path) -> None:
    write_files(tmp_path, CODEC)
    cloud = PointCloud(np.random.default_rng(0).random((50, 3)))
    write_cloud(tmp_path / "data" / "mine" / "a.ply", cloud, describe=False)
    (tmp_path / "data" / "mine" / "box.off").write_text(BOX)
    lines = "".join(block for name in ("README.md", DATA) for block in blocks(name, "sh"))
    shown = re.findall(r"^puckbench run .+?(?= *(?:#|$))", lines, re.MULTILINE)
    runs = [line for line in dict.fromkeys(shown) if "site/" not in line]  # as in the README
    assert len(runs) == 3
    _shell(tmp_path, "\n".join(runs))
    config = yaml.safe_load((tmp_path / "out" / "config.yaml").read_text())
    assert {"meshes", "clouds"} <= set(config["scene_sets"])


def test_the_default_run_makes_every_result_that_the_pages_name(tmp_path: Path) -> None:
    """What the pages ask Snakemake for without a configuration is planned, not run."""
    for name in ("workflow", "config", "benchmarks"):
        (tmp_path / name).symlink_to(ROOT / name)
    targets = {
        word
        for name in ("README.md", ONE_RESULT, THESIS)
        for words in commands(name)
        if words[0] == "snakemake" and "--configfile" not in words
        for word in words[1:]
        if not word.startswith("-") and word != "2" and "=" not in word
    }
    assert len(targets) >= 6
    program = [sys.executable, "-m", "snakemake", "--cores", "2", "--dry-run", "--quiet", "all"]
    done = subprocess.run(
        [*program, "--", *sorted(targets)],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-4000:]


def test_files_that_the_readme_names_exist() -> None:
    readme = page("README.md")
    named = set(re.findall(r"`((?:src|config|workflow|docs)/[\w./-]+)`|\]\(([\w./-]+)\)", readme))
    for path in {first or second for first, second in named}:
        assert (ROOT / path).exists(), path


def test_the_default_configuration_has_the_paths_that_the_pages_name() -> None:
    config = yaml.safe_load((ROOT / "config" / "config.yaml").read_text())
    assert "Area_1_office_1" in config["scene_sets"]["rooms"]["select"]
    assert "rooms_noisy" in config["datasets"]
    assert Path(ROOT / "config" / "README.md").exists()
