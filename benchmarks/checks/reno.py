"""RENO's bits with its authors' weights beside those of gpcc and the sparse octree net.

    python -m benchmarks.checks.reno WEIGHTS [frame.bin ...] [--streets 3] [--authors BITS.csv]

WEIGHTS is the folder of the authors' three sets (`puckbench data reno_weights`). Coded are frames
in metres, such as KITTI's .bin, and, without any, turns of a virtual HDL-64E in generated streets,
as `config/sweeps.yaml` has them. Prints the two tables of docs/notes/reno.md: bits at each posQ
with the set KITTIDetection and their ratio to gpcc's, and the ratios at 64 and 16 mm with every
set. With --authors, a table of what the authors' program takes (columns frame, posq, bits), also
the ratio to that. A codec opened anew decodes every stream, and has to give the same points.
"""

from __future__ import annotations

import argparse
import csv
import json
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from puckbench.codecs.base import Codec
from puckbench.codecs.registry import open_codec
from puckbench.codecs.reno import Reno
from puckbench.geometry.cloud import Floats
from puckbench.io.clouds import read_cloud
from puckbench.jobs.registry import JOBS
from puckbench.planning.config import read_config
from puckbench.planning.planned_job import PlannedJob
from puckbench.planning.workflow import Workflow

ROOT = Path(__file__).parents[2]
SETS = ("KITTIDetection", "SemanticKITTI", "Ford")
STUDY, DATASET = ROOT / "config" / "sweeps.yaml", "streets_hdl64e"
COMPARED = ("64mm", "16mm")
RATES = {name: dict(values) for name, values in Reno.metric_rates.items()}
Cell = tuple[str, str, str]
"""Codec, set of weights, rate."""


class Bits:
    """Bits of a cloud by codec and rate, each coded once."""

    def __init__(self, weights: Path, points: Floats) -> None:
        self._weights, self._points = weights, points
        self._known: dict[Cell, int] = {}

    def of(self, codec: str, rate: str, trained_on: str = "") -> int:
        """Bits of a stream whose points were found to come back."""
        key = (codec, trained_on, rate)
        if key not in self._known:
            coder, reader = (self._opened(codec, trained_on) for _ in range(2))
            stream = coder.encode(self._points, rate)
            assert np.array_equal(reader.decode(stream), coder.decode(stream)), key
            self._known[key] = 8 * len(stream)
        return self._known[key]

    def ratio(self, codec: str, rate: str, trained_on: str = "") -> float:
        """Bits over those of gpcc at the same step."""
        return self.of(codec, rate, trained_on) / self.of("gpcc", rate)

    def _opened(self, codec: str, trained_on: str) -> Codec:
        entry: dict[str, object] = {"metric_rates": RATES}
        if codec == "reno":
            entry["options"] = {"weights": str(self._weights), "trained_on": trained_on}
        return open_codec(codec, entry)


def virtual_turns(streets: int, folder: Path) -> Iterator[tuple[str, Floats]]:
    """Turns of the study of sweeps, made by its own jobs."""
    study = read_config(STUDY)
    data = {key: value for key, value in study["datasets"][DATASET].items() if key != "codecs"}
    scenes = {**study["scenes"][data["scenes"]], "limit": streets}
    bench = Workflow(
        {
            "results": str(folder),
            "seed": study["seed"],
            "scenes": {data["scenes"]: scenes},
            "datasets": {DATASET: data},
        }
    )
    for dataset, cloud in bench.plan.clouds:
        jobs = bench.clouds
        scene, table = Path(jobs.scene_file(dataset, cloud)), Path(jobs.source(dataset, cloud))
        made = folder / "clouds" / dataset / f"{cloud}.ply"
        _do(jobs.scene(data["scenes"], cloud), scene=scene)
        _do(jobs.scan(dataset, cloud), mesh=scene, table=table)
        files = {"returns": made.with_suffix(".parquet")}
        files["truth"] = Path(jobs.true_points(dataset, cloud))
        about = (scene.with_suffix(".json"),)
        more = {"box": about[0]} if jobs.is_cropped(dataset) else {}
        _do(jobs.prepare(dataset), source=table, cloud=made, about=about, **files, **more)
        yield cloud, read_cloud(made).xyz


def _do(job: PlannedJob, **files: object) -> None:
    JOBS.get(job.name).given(**json.loads(job.record)).run(**files)


def rates_table(bits: Mapping[str, Bits], authors: Mapping[tuple[str, str], int]) -> Iterator[str]:
    """Bits at every posQ, and their ratios to gpcc's and to the authors'."""
    given = {name for name, _ in authors}
    heads = ["posQ (mm)"]
    for name in bits:
        heads += [name, *(["authors", "ratio"] if name in given else []), f"{name}, `gpcc`"]
    yield _row(heads)
    yield _row(["---"] * len(heads))
    for rate in RATES:
        cells = [rate.removesuffix("mm")]
        for name, of in bits.items():
            own = of.of("reno", rate, SETS[0])
            cells.append(f"{own:,}")
            if name in given:
                theirs = authors.get((name, cells[0]))
                cells += [f"{theirs:,}", f"{own / theirs:.4f}"] if theirs else ["", ""]
            cells.append(f"{of.ratio('reno', rate, SETS[0]):.3f}")
        yield _row(cells)


def sets_table(bits: Mapping[str, Bits]) -> Iterator[str]:
    """Ratios to gpcc's bits at the compared steps, with each set of weights."""
    yield _row(["cloud", *SETS, "`sparse_octree_net`"])
    yield _row(["---"] * (len(SETS) + 2))
    for name, of in bits.items():
        asked = [*(("reno", one) for one in SETS), ("sparse_octree_net", "")]
        ratios = ([of.ratio(c, rate, one) for rate in COMPARED] for c, one in asked)
        yield _row([name, *("; ".join(f"{ratio:.3f}" for ratio in pair) for pair in ratios)])


def _row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def read_authors(path: Path | None) -> dict[tuple[str, str], int]:
    """Frame and posQ -> bits of the authors' program."""
    if path is None:
        return {}
    with path.open(encoding="utf-8", newline="") as file:
        return {(row["frame"], row["posq"]): int(row["bits"]) for row in csv.DictReader(file)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("weights", type=Path, help="folder of the authors' sets")
    parser.add_argument("frames", type=Path, nargs="*", help="clouds in metres")
    parser.add_argument("--streets", type=int, help="virtual turns (default: 3 without frames)")
    parser.add_argument("--authors", type=Path, help="bits of the authors' program (CSV)")
    options = parser.parse_args()
    clouds = {path.stem: read_cloud(path).xyz for path in options.frames}
    streets = options.streets if options.streets is not None else 0 if clouds else 3
    with tempfile.TemporaryDirectory() as folder:
        clouds |= dict(virtual_turns(streets, Path(folder))) if streets else {}
    bits = {name: Bits(options.weights, points) for name, points in clouds.items()}
    for line in rates_table(bits, read_authors(options.authors)):
        print(line, flush=True)
    print()
    for line in sets_table(bits):
        print(line, flush=True)


if __name__ == "__main__":
    main()
