"""Curves coded and measured in one process give what one process for each rate gives."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cloud_files.clouds import read_cloud, write_cloud
from cloud_files.meshes import write_mesh
from pointkit.errors import InputError
from pointkit.files import read_json
from pointkit.geometry.cloud import Floats, PointCloud
from pointkit.geometry.mesh import Mesh
from pointkit.geometry.spatial_order import Rows, distinct_points
from primitive_codec import mode_decision
from puckbench.cli import main
from puckbench.codecs.registry import codec_class
from puckbench.core.archives import read_archive, write_archive
from puckbench.library import compare, open_codec
from puckbench.metrics import geometry
from puckbench.results.columns import column_named
from puckbench.results.curves import Coded, read_curve, write_curve
from puckbench.results.row_files import read_rows, write_rows
from puckbench.steps.coding import Decoded
from puckbench.steps.decode_shown import DecodeShown
from puckbench.steps.encode import Encode
from puckbench.steps.evaluate import Evaluate, Measuring, Originals

RATES = ("r1", "r4", "r8")
NAME = "airplane_01"
COUNTING = """
from pathlib import Path

from puckbench.codecs.base import Codec, PointCloud


class Counting(Codec):
    rates = {f"r{rate}": {} for rate in range(1, 6)}
    costs = {"base_s": 0.0, "million_s": 2000.0}

    def load(self):
        with Path("loads").open("a") as loads:
            loads.write("x")

    def encode(self, cloud, rate):
        return cloud.xyz.tobytes()

    def decode(self, stream):
        import numpy as np

        return PointCloud(np.frombuffer(stream).reshape(-1, 3))
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cloud over a floor, the floor, and points on it."""
    monkeypatch.chdir(tmp_path)
    floor = Mesh(
        np.array([[0.0, 0, 0], [9, 0, 0], [9, 9, 0], [0, 9, 0]]), np.array([[0, 1, 2], [0, 2, 3]])
    )
    write_mesh(Path("floor.ply"), floor, {})
    random = np.random.default_rng(3)
    xyz = random.random((3000, 3)) * [900, 900, 5]
    up = np.tile([0.0, 0, 1], (len(xyz), 1))
    about = {"scale": 100.0, "offset": [0.0, 0.0, 0.0], "size": 1024, "name": "floor"}
    write_cloud(Path("cloud.ply"), PointCloud(xyz, up, about=about))
    write_cloud(Path("seen.ply"), PointCloud(xyz * [1, 1, 0], up))
    return tmp_path


def entry(codec: str) -> dict[str, Any]:
    return {"rates": {rate: codec_class(codec).rates[rate] for rate in RATES}}


@pytest.mark.parametrize("codec", ["draco", "gpcc", "primitives"])
def test_a_curve_in_one_process_has_the_results_of_its_rates_alone(
    folder: Path, codec: str
) -> None:
    cloud, truth = Path("cloud.ply"), {"truth": Path("floor.ply"), "visible": Path("seen.ply")}
    curve, rows, clouds = Path("curve.zip"), Path("rows.parquet"), Path("clouds.zip")
    Encode(codec=codec, repeats=1, entry=entry(codec)).run(cloud, curve)
    done = Evaluate(codec=codec, dataset="d", repeats=1).run(cloud, curve, rows, **truth)
    DecodeShown(codec=codec, rates=RATES[1:]).run(curve, clouds)
    results, shown = read_rows([rows]), read_archive(clouds)
    assert [row["rate"] for row in results] == [*RATES]
    for coded, row in zip(read_curve(curve).values(), results, strict=True):
        rate = row["rate"]
        stream, alone = (Path(f"{rate}{suffix}") for suffix in (".bin", ".json"))
        words = [str(cloud), str(stream), "--codec", codec, "--rate", rate]
        assert main(["encode", *words]) == 0
        words = [str(cloud), str(stream), "--dataset", "d", "--row", str(alone)]
        assert main(["evaluate", *words, "--truth", "floor.ply", "--visible", "seen.ply"]) == 0
        assert stream.read_bytes() == coded.stream
        assert timeless(read_json(alone)) == timeless(row)
        if rate in shown:
            assert main(["decode", str(stream), "alone.ply"]) == 0
            assert Path("alone.ply").read_bytes() == shown[f"{rate}.ply"]
    assert list(shown) == [f"{rate}.ply" for rate in RATES[1:]]
    assert done == {"rates": 3}


def test_the_rates_of_a_curve_share_the_search_for_a_surface(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    searches: list[int] = []
    search = mode_decision._best_surface

    def counted(*args: Any) -> Any:
        searches.append(1)
        return search(*args)

    monkeypatch.setattr(mode_decision, "_best_surface", counted)
    changes, cloud = {"rates": ["r5", "r6", "r8"]}, read_cloud(Path("cloud.ply"))
    Encode(codec="primitives", repeats=1, entry=changes).run(Path("cloud.ply"), Path("c.zip"))
    loading = 1  # compiles the search
    assert len(searches) == loading + 1
    compare(cloud, [open_codec("primitives", changes)])
    assert len(searches) == 2 * (loading + 1)


def timeless(row: dict[str, Any]) -> dict[str, Any]:
    return {
        key: value
        for key, value in row.items()
        if not column_named(key).timed and "peak_mib" not in key
    }


def test_commands_read_a_rate_of_a_curve(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Encode(codec="draco", repeats=1, entry=entry("draco")).run(Path("cloud.ply"), Path("c.zip"))
    assert main(["decode", "c.zip", "out.ply", "--rate", "r4"]) == 0
    assert main(["evaluate", "cloud.ply", "c.zip", "--rate", "r4", "--json"]) == 0
    assert '"rate": "r4"' in capsys.readouterr().out
    assert main(["decode", "c.zip", "out.ply"]) == 2
    assert "c.zip: name one of its rates (--rate: r1, r4, r8)" in capsys.readouterr().err
    assert main(["decode", "c.zip", "out.ply", "--rate", "r2"]) == 2
    assert "c.zip: no rate 'r2'" in capsys.readouterr().err


def test_a_curve_has_the_same_bytes_whenever_it_is_written(folder: Path) -> None:
    coded = {"r1": Coded(b"one", {"bytes": 3}), "r2": Coded(b"two", {"bytes": 3})}
    for name in ("a.zip", "b.zip"):
        write_curve(Path(name), coded)
        write_rows(Path(name).with_suffix(".parquet"), [{"a": 1, "b": 0.1}, {"a": 2, "c": "x"}])
    assert Path("a.zip").read_bytes() == Path("b.zip").read_bytes()
    assert Path("a.parquet").read_bytes() == Path("b.parquet").read_bytes()
    assert read_curve(Path("a.zip")) == coded
    assert read_rows([Path("a.parquet")]) == [{"a": 1, "b": 0.1}, {"a": 2, "c": "x"}]


@pytest.mark.parametrize("name", ["folder/r1.bin", "/r1.bin", ".bin"])
def test_an_archive_with_folders_is_no_curve(name: str, tmp_path: Path) -> None:
    write_archive(tmp_path / "odd.zip", {"r1.bin": b"a", "r1.json": b"{}", name: b"b"})
    with pytest.raises(InputError, match=rf"odd\.zip: not a curve: its member '{name}' is not"):
        read_curve(tmp_path / "odd.zip")


def test_a_decoded_cloud_is_made_ready_once_for_all_that_it_is_compared_with(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    originals = Originals(Path("cloud.ply"), Path("floor.ply"), Path("seen.ply"))
    made: list[int] = []

    def counted(points: Floats) -> tuple[Rows, Floats]:
        made.append(len(points))
        return distinct_points(points)

    monkeypatch.setattr(geometry, "distinct_points", counted)
    row = Measuring(dataset="d").row(originals, Decoded(read_cloud(Path("cloud.ply")), {}))
    assert row["cd_point"] == 0 < row["truth_cd_point"]
    assert made == [3000]


def test_a_codec_is_loaded_once_for_a_curve(folder: Path) -> None:
    Path("counting.py").write_text(COUNTING)
    changes: dict[str, Any] = {"class": "counting.py:Counting"}
    curve, rows = Path("c.zip"), Path("c.parquet")
    changes["rates"] = {rate: {} for rate in RATES}
    Encode.create(codec="mine", entry=changes).run(Path("cloud.ply"), curve)
    assert Path("loads").read_text() == "x"
    Evaluate(codec="mine", repeats=1, entry=changes).run(Path("cloud.ply"), curve, rows)
    assert Path("loads").read_text() == "xx"
