"""Curves coded and measured in one process give what one process for each rate gives."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from puckbench.codecs.base import Pace
from puckbench.geometry.cloud import Floats, PointCloud
from puckbench.geometry.mesh import Mesh
from puckbench.geometry.spatial_order import Rows, distinct_points
from puckbench.io.clouds import write_cloud
from puckbench.io.meshes.writing import write_mesh
from puckbench.jobs.decode import Decode
from puckbench.jobs.encode import Encode, EncodeCurve
from puckbench.jobs.evaluate import Evaluate, EvaluateCurve, Originals
from puckbench.metrics import geometry
from puckbench.planning.coding import Curve
from puckbench.planning.same_results import compared, differences
from puckbench.planning.workflow import Workflow

RATES = ("r1", "r4", "r8")
COUNTING = """
from pathlib import Path

from puckbench.codecs.base import Codec, Pace


class Counting(Codec):
    rates = {f"r{rate}": {} for rate in range(1, 6)}
    pace = Pace(0.0, 2000.0)

    def load(self):
        with Path("loads").open("a") as loads:
            loads.write("x")

    def _encode(self, points, parameters):
        return points.tobytes()

    def _decode(self, stream):
        import numpy as np

        return np.frombuffer(stream).reshape(-1, 3)
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


def files(folder: str, suffix: str) -> tuple[Path, ...]:
    return tuple(Path(folder) / f"{rate}{suffix}" for rate in RATES)


@pytest.mark.parametrize("codec", ["draco", "gpcc", "primitives"])
def test_a_curve_in_one_process_has_the_results_of_its_rates_alone(
    folder: Path, codec: str
) -> None:
    cloud, truth = Path("cloud.ply"), {"truth": Path("floor.ply"), "visible": Path("seen.ply")}
    EncodeCurve(codec=codec).run(cloud, files("curve", ".bin"))
    done = EvaluateCurve(codec=codec, dataset="d").run(
        cloud,
        files("curve", ".bin"),
        files("curve", ".json"),
        files("curve/decoded", ".ply")[1:],
        **truth,
    )
    for rate in RATES:
        stream, row = (Path("alone") / f"{rate}{suffix}" for suffix in (".bin", ".json"))
        Encode(codec=codec, rate=rate).run(cloud, stream)
        Evaluate(codec=codec, dataset="d").run(cloud, stream, row, **truth)
        if rate != RATES[0]:
            Decode(codec=codec).run(stream, Path("alone/decoded") / f"{rate}.ply")
    assert differences(Path("curve"), Path("alone")) == []
    assert len(list(compared(Path("curve")))) == 5 * len(RATES) - 2
    rows = [json.loads(path.read_text()) for path in files("curve", ".json")]
    assert done["call_s"] == pytest.approx(sum(row["decode_s"] for row in rows))
    assert (done["codec"], done["points"], done["rates"]) == (codec, 3000, 3)
    assert done["truth"]


def test_a_decoded_cloud_is_made_ready_once_for_all_that_it_is_compared_with(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    originals = Originals(Path("cloud.ply"), Path("floor.ply"), Path("seen.ply"))
    made: list[int] = []

    def counted(points: Floats) -> tuple[Rows, Floats]:
        made.append(len(points))
        return distinct_points(points)

    monkeypatch.setattr(geometry, "distinct_points", counted)
    row = Evaluate(dataset="d").row(originals, Path("cloud.ply"))
    assert row["cd_point"] == 0 < row["truth_cd_point"]
    assert made == [3000]


def test_a_codec_is_loaded_once_for_a_curve(folder: Path) -> None:
    Path("counting.py").write_text(COUNTING)
    changes: dict[str, Any] = {"class": "counting.py:Counting"}
    streams, rows = files("c", ".bin"), files("c", ".json")
    changes["rates"] = {rate: {} for rate in RATES}
    EncodeCurve.given(codec="mine", changes=changes).run(Path("cloud.ply"), streams)
    assert Path("loads").read_text() == "x"
    EvaluateCurve(codec="mine", changes=changes).run(Path("cloud.ply"), streams, rows)
    assert Path("loads").read_text() == "xx"


def parts(points: int, repeats: int = 1) -> list[Curve]:
    plan = {
        "scenes": {"a": {"loader": "embedded_objects", "limit": 1}},
        "datasets": {"d": {"scenes": "a", "make": "sample", "points": points}},
        "codecs": {"mine": {"class": "counting.py:Counting"}},
        "timing": {"repeats": repeats},
    }
    return list(Workflow(plan).coding.curves)


def test_a_curve_of_more_than_ten_minutes_is_cut_by_rates(folder: Path) -> None:
    Path("counting.py").write_text(COUNTING)
    assert Pace(0.0, 2000.0).of(50_000) == 100
    (whole,) = parts(50_000)  # five rates of 100 s
    assert whole.name("encode") == "encode_mine"
    first, second = parts(50_000, repeats=2)
    assert first.rates + second.rates == ("r1", "r2", "r3", "r4", "r5")
    assert first.name("encode") == "encode_mine_r1_to_r3"
    assert first.files("coded", ".bin")[2] == "coded/{dataset}/{cloud}/mine/r3.bin"
    assert [part.rates for part in parts(10_000_000)] == [(f"r{n}",) for n in range(1, 6)]
