"""A study whose codecs lie at known distances, and a run of another codec on its clouds."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pandas as pd

from pointkit.files import write_bytes
from pointkit.tables import write_table
from puckbench.planning.workflow import Workflow
from puckbench.report.reference_results import (
    ReferenceResults,
    plain_rows,
    read_reference,
    write_reference,
)
from puckbench.report.run_record import RunRecord
from tests.support.in_process import run_in_process

CLOUDS = {("objects", f"thing_{number}"): f"{number:032x}" for number in range(4)}
"""Data set and name of each cloud -> its digest."""
DRACO, GPCC, MINE = 1.0, 0.8, 0.5
"""Bits of each codec over those of the first, at every quality."""
PEAK = 1023.0


def rows_of(codec: str, bits: float) -> pd.DataFrame:
    """Result rows of a codec; clouds differ in their bits, not in the ratio of codecs."""
    return pd.DataFrame(
        {
            "dataset": dataset,
            "cloud": cloud,
            "codec": codec,
            "rate": f"r{rate}",
            "bytes": int(1000 * bits * 2**rate * (1 + number)),
            "bpp": bits * 2.0**rate * (1 + number),
            "d1_psnr": 40.0 + 6 * rate,
            "d2_psnr": 45.0 + 6 * rate,
            "d1_mse": 3 * PEAK**2 * 10 ** -(4.0 + 0.6 * rate),
            "encode_s": 0.1,
            "decode_s": 0.05,
            "codec_version": "1",
        }
        for number, (dataset, cloud) in enumerate(CLOUDS)
        for rate in range(1, 6)
    )


def clouds_of(digests: dict[tuple[str, str], str]) -> pd.DataFrame:
    """The table of clouds."""
    rows = [
        {"dataset": dataset, "cloud": cloud, "points": 8000, "digest": digest}
        for (dataset, cloud), digest in digests.items()
    ]
    return pd.DataFrame(rows)


def write_study(file: Path, **columns: Any) -> Path:
    """Reference results of Draco and G-PCC, with further columns."""
    metrics = pd.concat([rows_of("draco", DRACO), rows_of("gpcc", GPCC)]).assign(**columns)
    about = {
        "configuration": {},
        "style": [{"dataset_titles": {"objects": "Things"}}],
        "bd_rate": {"anchor": "gpcc", "qualities": ["d1_psnr", "d2_psnr"]},
        "machine": {"Processor": "a & b"},
        "record": RunRecord().as_json(),
        "clouds": plain_rows(clouds_of(CLOUDS)),
    }
    write_reference(file, metrics.reset_index(drop=True), about)
    return file


def write_run(
    folder: Path, metrics: pd.DataFrame, digests: dict[tuple[str, str], str] | None = None
) -> Path:
    """The tables of a run."""
    write_table(metrics, folder / "tables" / "metrics.parquet")
    write_table(clouds_of(digests or CLOUDS), folder / "tables" / "clouds.parquet")
    return folder


def write_logs(folder: Path, share: float) -> None:
    """Logs of a curve that was coded and measured in 10 s of processor time, and of a figure."""
    when = {"ended": "2026-05-03T10:00:00+00:00", "commit": "0123456789ab"}
    for job, wall in (("encode", 6), ("evaluate", 4), ("figure", 100)):
        cost = {"job": job, "processor_s": wall, "wall_s": wall / share, **when}
        if job == "figure":  # what others took while it was drawn says nothing
            cost["wall_s"] = 10 * wall
        write_bytes(folder / f"{job}.log", f"{json.dumps(cost)}\n".encode())


def kept(config: dict[str, Any], folder: Path, share: float = 1.0) -> ReferenceResults:
    """The results of a small study, kept as `make reference` keeps them.

    share: of their time in which its coding jobs had a processor, as their logs tell.
    """
    config = {**config, "results": str(folder / "results")}
    metrics, clouds = run_in_process(config)
    write_logs(folder / "results" / "logs", share)
    files = {"metrics": folder / "metrics.parquet", "clouds": folder / "clouds.parquet"}
    write_table(metrics, files["metrics"])
    write_table(clouds, files["clouds"])
    step = Workflow(config).step("reference")
    done = type(step.step).create(**json.loads(step.settings))
    done.run(**files, out=folder / "small.parquet")
    return read_reference(str(folder / "small.parquet"))
