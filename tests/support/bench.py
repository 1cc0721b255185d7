"""A tiny benchmark in a folder of its own: an object, a room, three codecs, a sensor study."""

from __future__ import annotations

import csv
import json
import os
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Mapping
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import yaml

ROOT = Path(__file__).parents[2]

# Planning imports for two seconds; processes that this one forks have the modules.
_FORKS = get_context("forkserver")
_FORKS.set_forkserver_preload(
    ["snakemake.cli", "puckbench.planning.workflow", "puckbench.planning.run_time"]
)

RAW_CODEC = """
import numpy as np
from puckbench.codecs.base import Codec, PointCloud


class Raw(Codec):
    version = "raw 1"

    def encode(self, cloud, rate):
        return np.round(cloud.xyz / self.rates[rate]["step"]).astype("<i2").tobytes()

    def decode(self, stream):
        return PointCloud(np.frombuffer(stream, "<i2").reshape(-1, 3) * 1.0)
"""

BOX_CODEC = """
import numpy as np
from puckbench.codecs.base import Codec, PointCloud
from pointkit.errors import InputError
from pointkit.geometry.mesh import Labels, Mesh, Primitive, SceneObject

SIDES = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]


class Box(Codec):
    version = "box 1"

    def encode(self, cloud, rate):
        corners = np.array([cloud.xyz.min(axis=0), cloud.xyz.max(axis=0)])
        return corners.tobytes() + (b"points" if "points" in self.rates[rate] else b"")

    def decode(self, stream):
        low, high = np.frombuffer(stream[:48]).reshape(2, 3)
        corners = np.stack(np.unravel_index(np.arange(8), (2, 2, 2)), axis=1)
        return PointCloud(low + corners * (high - low))

    def surfaces(self, stream):
        if stream.endswith(b"points"):
            raise InputError("no surface")
        vertices = self.decode(stream).xyz
        quads = np.array(SIDES)
        triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
        normals = np.eye(3)[[0, 0, 1, 1, 2, 2]]
        planes = tuple(
            Primitive("plane", {"normal": n.tolist(), "offset": float(n @ vertices[side[0]])})
            for n, side in zip(normals, SIDES)
        )
        objects = tuple(SceneObject(f"side_{k}", "side") for k in range(6))
        number = np.tile(np.arange(6, dtype=np.int32), 2)
        return Mesh(vertices, triangles, Labels(number, number, objects, planes))
"""

CONFIG: dict[str, Any] = {
    "results": "results",
    "seed": 1,
    "thesis": True,
    "scene_sets": {
        "objects": {"loader": "embedded_objects", "select": ["chair_01"]},
        "rooms": {
            "loader": "embedded_rooms",
            "options": {"rooms": ["copy_room_1"], "detail": 0.3},
        },
    },
    "datasets": {
        "objects": {"scene_set": "objects", "make": "sample", "points": 2000, "recovery": False},
        "raw": {"scene_set": "rooms", "make": "sample", "points": 2000},
        "clean": {"scene_set": "rooms", "make": "scan", "sweep": {"duration_s": 0.02}},
        "noisy": {
            "scene_set": "rooms",
            "make": "scan",
            "errors": "vlp16_divergence",
            "sweep": {"duration_s": 0.02},
        },
    },
    "codecs": {
        "draco": {"rates": ["r1", "r8"]},
        "raw_grid": {"class": "raw_grid.py:Raw", "rates": {"r1": {"step": 1.0}}},
        "box": {
            "class": "box.py:Box",
            "surfaces": True,
            "rates": {"r1": {}, "r2": {"points": True}},
        },
    },
    "sensor_study": {
        "models": {"vlp16": {}, "vlp16_divergence": {}},
        "distances_m": [1, 5],
        "runs": 1,
        "rows": 300,
    },
    "timing": {"repeats": 1},
    "figures": {
        "style": {"dpi": 60},
        "examples": {
            "object": "objects/chair_01",
            "raw": "raw/copy_room_1",
            "clean": "clean/copy_room_1",
            "noisy": "noisy/copy_room_1",
        },
    },
}


BOX = """OFF
8 6 0
-2.5 -2.5 0
2.5 -2.5 0
2.5 2.5 0
-2.5 2.5 0
-2.5 -2.5 2.5
2.5 -2.5 2.5
2.5 2.5 2.5
-2.5 2.5 2.5
4 0 1 2 3
4 7 6 5 4
4 0 4 5 1
4 1 5 6 2
4 2 6 7 3
4 3 7 4 0
"""


class Bench:
    """A folder with a configuration, in which the workflow runs."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.snakefile = ROOT / "workflow" / "Snakefile"
        self.results = folder / "results"
        (folder / "raw_grid.py").write_text(RAW_CODEC)
        (folder / "box.py").write_text(BOX_CODEC)
        self.configure({})

    def configure(self, changes: Mapping[str, Any]) -> None:
        """Write the configuration with some values replaced, named by dotted keys."""
        config = yaml.safe_load(yaml.safe_dump(CONFIG))
        for key, value in changes.items():
            *path, last = key.split(".")
            place = config
            for part in path:
                place = place[part]
            place[last] = value
        (self.folder / "config.yaml").write_text(yaml.safe_dump(config, sort_keys=False))

    def copied(self, folder: Path) -> Bench:
        """Copy this folder to a new one, without Snakemake's memory."""
        folder.mkdir()
        copy = Bench(folder)
        copy.snakefile = self.snakefile
        ignored = shutil.ignore_patterns(".snakemake")
        shutil.copytree(self.folder, folder, ignore=ignored, dirs_exist_ok=True)
        return copy

    def capture(self, turns: int = 3) -> str:
        """Write the packets of turns in an empty room, of one device; the file's name."""
        (self.folder / "box.off").write_text(BOX)
        changes = {"duration_s": round(0.2 * turns, 1), "azimuth_step_deg": 0.4}
        sweep = json.dumps({"preset": "spin", **changes})
        noise = ["--errors", "vlp16", "--error-options", '{"bias_redrawn": "scan"}']
        for words in (
            ["scan", "box.off", "box.parquet", "--sweep", sweep, *noise],
            ["export", "box.parquet", "box.pcap"],
        ):
            subprocess.run(
                [sys.executable, "-m", "puckbench", *words],
                cwd=self.folder,
                env={**os.environ, "PYTHONPATH": str(ROOT / "src")},
                capture_output=True,
                check=True,
            )
        return "box.pcap"

    def command(self, *arguments: str) -> list[str]:
        """A `snakemake` command line for this folder."""
        program = [
            sys.executable,
            "-m",
            "snakemake",
            "--snakefile",
            str(self.snakefile),
        ]
        return [*program, "--configfile", "config.yaml", "--cores", "2", *arguments]

    def snakemake(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        """Run the workflow to its end, whatever that is."""
        words = self.command(*arguments)
        if self.snakefile.parents[1] != ROOT:  # which has sources of its own
            return subprocess.run(
                words, cwd=self.folder, capture_output=True, text=True, check=False
            )
        with TemporaryDirectory() as folder:
            files = [Path(folder, name) for name in ("output", "errors")]
            process = _FORKS.Process(
                target=_snakemake, args=(words[3:], self.folder, dict(os.environ), files)
            )
            process.start()
            process.join()
            texts = [file.read_text() for file in files]
        return subprocess.CompletedProcess(words, process.exitcode or 0, *texts)

    def made(self, *arguments: str) -> None:
        """Run the workflow; the test fails when it does."""
        done = self.snakemake(*arguments)
        assert done.returncode == 0, done.stderr[-4000:]

    def planned(self, *arguments: str) -> dict[str, int]:
        """Jobs that a run would do now: how many, by the names that `_name` gives them."""
        done = self.snakemake("--summary", *arguments)
        assert done.returncode == 0, done.stderr[-4000:]
        rows = csv.DictReader(done.stdout.splitlines(), delimiter="\t")
        jobs = {
            (  # below results/FOLDER; a table's dictionary of columns is of the table's job
                Path(row["output_file"].replace("/columns/", "/")).with_suffix("").parts[2:],
                _name(row["rule"], row["output_file"]),
            )
            for row in rows
            if row["plan"] != "no update"
        }
        return dict(Counter(name for _, name in jobs))


def _snakemake(
    words: list[str], folder: Path, environment: dict[str, str], outputs: list[Path]
) -> None:
    """Do as `python -m snakemake` does, in a process that has imported it."""
    from snakemake.cli import main

    for number, file in enumerate(outputs, start=1):
        with file.open("w") as stream:
            os.dup2(stream.fileno(), number)
    os.environ.clear()
    os.environ.update(environment)
    os.chdir(folder)
    main(words)


def _name(rule: str, output: str) -> str:
    """A job by its rule, with its table, its figure or its codec (and rate) where it has one."""
    path = Path(output)
    if rule in ("figure", "table"):
        return path.stem
    if rule in ("results_table", "study_table"):
        return f"{path.stem}_table"
    if rule in ("encode", "evaluate", "recovery", "decode_shown"):
        return f"{rule}_{path.stem}"
    return f"{rule}_{path.parent.name}_{path.stem}" if rule == "decode" else rule
