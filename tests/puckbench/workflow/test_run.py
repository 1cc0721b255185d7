"""`puckbench run` from a user's files to the table, and again on what it wrote."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pandas as pd
import trimesh

from cloud_files.clouds import read_cloud
from puckbench.cli import main
from tests.cloud_files.test_cloud_formats import COLOURS, INTENSITY, UTM, write_las
from tests.support.bench import ROOT
from tests.support.reference_lookalike import kept

OWN = """
import zlib

import numpy as np
from puckbench.codecs.base import Codec, PointCloud, lengths, parameters_of


class Steps(Codec):
    title = "Steps"
    rates = lengths(100, 50, 20, 10)

    def encode(self, cloud, rate):
        step = parameters_of(self, rate)["step_m"]
        whole = np.rint(cloud.xyz / step).astype("<i4").tobytes()
        return np.float64(step).tobytes() + zlib.compress(whole)

    def decode(self, stream):
        whole = np.frombuffer(zlib.decompress(stream[8:]), "<i4").reshape(-1, 3)
        return PointCloud(whole * np.frombuffer(stream[:8]))
"""


def run(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "puckbench", "run", *words, "--cores", "2"],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT / "src")},
        capture_output=True,
        text=True,
        check=False,
    )


def test_a_surveyed_cloud_is_compared_in_one_command(tmp_path: Path) -> None:
    write_las(tmp_path / "site.las")
    (tmp_path / "codecs").mkdir()
    (tmp_path / "codecs" / "mine.py").write_text(OWN)
    (tmp_path / "torn.las").write_bytes(b"LASF")
    words = ["site.las", "torn.las", "--codecs", "draco", "codecs/mine.py:Steps"]
    done = run(tmp_path, *words, "--rates", "100mm", "50mm", "20mm", "10mm", "--out", "out")
    assert done.returncode == 0, done.stderr[-4000:]
    head, draco, steps, *rest = done.stdout.splitlines()
    assert head.split()[:3] == ["data", "set", "codec"]
    assert draco.split()[:3] == ["Clouds", "Draco", "1"]
    assert "Steps" in steps
    assert "%" in steps
    assert "report:  out/report.html" in rest
    assert rest[-1].endswith("then: puckbench run out/config.yaml")
    assert "left out: torn.las: not a readable LAS file" in done.stdout
    report = (tmp_path / "out" / "report.html").read_text()
    for reduction in ("colours, intensity", "their place: coded clouds are shifted"):
        line = f"left out: clouds: {reduction}"
        assert f"puckbench: {line}" in done.stderr
        assert line in done.stdout
        assert reduction in report
    metrics = pd.read_csv(tmp_path / "out" / "tables" / "metrics.csv")
    # Of a grid of 10 mm no coordinate is off by more than a half of that.
    assert metrics[metrics.rate == "10mm"].d1_rms_m.between(0, 0.005 * 3**0.5).all()
    assert metrics.bpp.groupby(metrics.codec).min()["steps"] > 40
    clouds = pd.read_csv(tmp_path / "out" / "tables" / "clouds.csv")
    assert clouds["source"].tolist() == ["site.las"]
    cloud = read_cloud(tmp_path / "out" / "clouds" / "clouds" / "site.ply")
    assert abs(cloud.to_metres(cloud.xyz) - UTM).max() < 2e-9
    assert (cloud.colours == COLOURS).all()
    assert (cloud.fields["intensity"] == INTENSITY).all()

    curve = tmp_path / "out" / "coded" / "clouds" / "site" / "draco.zip"
    words_of_decode = ["decode", str(curve), str(tmp_path / "site.ply"), "--rate", "10mm"]
    assert main([*words_of_decode, "--like", str(tmp_path / "out/clouds/clouds/site.ply")]) == 0
    decoded = read_cloud(tmp_path / "site.ply").xyz
    assert (abs(decoded.min(axis=0) - UTM.min(axis=0)) < 0.01).all()
    assert (abs(decoded.max(axis=0) - UTM.max(axis=0)) < 0.01).all()

    # At once again, when the table is younger than clocks of servers may differ.
    once_more = run(tmp_path, *words, *("--rates", "100mm", "50mm", "20mm", "10mm"))
    assert "Nothing to be done" in once_more.stderr
    assert once_more.stdout.splitlines() == [head, draco, steps, *rest]

    again = run(tmp_path, "out/config.yaml", "--json")
    assert again.returncode == 0
    assert "Nothing to be done" in again.stderr
    answer = json.loads(again.stdout)
    assert [row["codec"] for row in answer["results"]] == ["Draco", "Steps"]
    deltas = pd.read_csv(tmp_path / "out" / "tables" / "bd_rate.csv")
    expected = deltas[deltas.metric == "d1_psnr"].bd_rate_percent.item()
    assert answer["results"][1]["bd_rate_percent"] == expected
    assert answer["report"] == "out/report.html"


COARSE = """
import numpy as np
from puckbench.codecs.base import Codec, PointCloud


class Coarse(Codec):
    title = "Coarse"
    rates = {f"r{step}": {"step": 2.0 ** (5 - step)} for step in (1, 2, 3)}

    def encode(self, cloud, rate):
        step = self.rates[rate]["step"]
        grid = np.unique(np.rint(cloud.xyz / step).astype("<u2"), axis=0)
        return np.float32(step).tobytes() + grid.tobytes()

    def decode(self, stream):
        cells = np.frombuffer(stream[4:], "<u2").reshape(-1, 3)
        return PointCloud((cells * np.frombuffer(stream[:4], "<f4")).astype(float))
"""


def test_ones_own_codec_is_compared_with_a_study_in_two_commands(tmp_path: Path) -> None:
    config = {
        "seed": 3,
        "scene_sets": {"some": {"loader": "embedded_objects", "select": ["lamp_01", "chair_01"]}},
        "datasets": {
            "few": {"scene_set": "some", "make": "sample", "points": 900, "truth": False},
            "many": {"scene_set": "some", "make": "sample", "points": 1500, "truth": False},
        },
        "codecs": {"draco": {"rates": ["r2", "r4", "r6"]}},
        "timing": {"repeats": 1},
    }
    study = kept(config, tmp_path / "theirs")
    (tmp_path / "mine.py").write_text(COARSE)
    words = ["--codecs", "mine.py:Coarse", "--datasets", "many", "--out", "out"]
    done = run(tmp_path, "--study", "theirs/small.parquet", *words)
    assert done.returncode == 0, done.stderr[-4000:]
    (tmp_path / "theirs" / "results").rename(tmp_path / "gone")
    last = done.stdout.splitlines()[-1]
    assert last == ("to compare with the study: puckbench compare out --with theirs/small.parquet")
    assert set(pd.read_csv(tmp_path / "out" / "tables" / "metrics.csv")["dataset"]) == {"many"}
    compared = subprocess.run(
        [sys.executable, "-m", "puckbench", *last.split()[6:], "--json"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT / "src")},
        capture_output=True,
        text=True,
        check=False,
    )
    assert compared.returncode == 0, compared.stderr
    answer = json.loads(compared.stdout)
    assert answer["codecs"] == ["coarse"]
    (delta,) = [row for row in answer["deltas"] if row["metric"] == "d1_psnr"]
    assert (delta["dataset"], delta["anchor"], delta["clouds"]) == ("many", "draco", 2)
    assert set(study.metrics["dataset"]) == {"few", "many"}


def test_a_recording_and_a_scanned_mesh_are_compared_in_one_command(tmp_path: Path) -> None:
    room = trimesh.creation.box((6, 5, 3))
    room.invert()
    room.apply_translation((0, 0, 1.5))
    room.export(tmp_path / "room.ply")
    table, recording = str(tmp_path / "turns.parquet"), tmp_path / "drive.pcap"
    sweep = '{"preset": "spin", "duration_s": 0.6, "azimuth_step_deg": 1}'
    words = ["--errors", "vlp16", "--sweep", sweep, "--origin", "0", "0", "1.5"]
    assert main(["scan", str(tmp_path / "room.ply"), table, *words]) == 0
    assert main(["export", table, str(recording)]) == 0
    asked = ["--scan", "--frame", "metric", "--codecs", "draco", "puck", "--rates", "100mm", "2mm"]
    done = run(tmp_path, "drive.pcap", "room.ply", *asked, "--json")
    assert done.returncode == 0, done.stderr[-4000:]
    rows = json.loads(done.stdout)["results"]
    assert [(row["dataset"], row["codec"]) for row in rows] == [
        (dataset, codec) for dataset in ("Scans", "Recordings") for codec in ("Draco", "Puck")
    ]
    metrics = pd.read_csv(tmp_path / "out" / "tables" / "metrics.csv")
    assert set(metrics.cloud) == {"drive_0001", "room"}
    assert metrics.d1_rms_m.between(0, 0.1).all()
    exact = metrics[(metrics.codec == "puck") & (metrics.rate == "2mm")]
    assert (exact.d1_rms_m == 0).all()
    assert (exact.returns_lost == 0).all()
    # A turn of 360 columns of 16 lasers, all of which see a wall; twice as fine is its default.
    assert metrics[metrics.cloud == "drive_0001"].points_in.between(5700, 5760).all()
    assert metrics[metrics.dataset == "recordings"].encode_real_time.gt(0).all()
