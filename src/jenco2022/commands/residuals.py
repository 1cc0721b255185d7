from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from puckbench.cli.registry import COMMANDS
from puckbench.cli.types import integer, json_object, refuse, selected

_DISTANCES_M = [1.0, 2.0, 3.0, 4.0, 5.0]
_FOR_SCANS = {
    "model": "vlp16",
    "model_options": {},
    "distances": _DISTANCES_M,
    "seed": 0,
    "keep": None,
    "runs": 3,
    "refit": False,
}
"""Options that have no effect on a real capture, with their defaults."""


def arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("out", type=Path, help="residual table to write (.parquet)")
    add("--model", default="vlp16", help="error model (default: vlp16)")
    text = "changes to the error model's parameters (JSON)"
    add("--model-options", type=json_object, default={}, help=text)
    text = "distances from the sensor to the wall, in metres: 1 to 5 (default), or 30"
    add("--distances", nargs="+", type=float, default=_DISTANCES_M, metavar="M", help=text)
    add("--seed", type=integer(0), default=0)
    add("--keep", type=integer(1), help="rows of each scan to keep, chosen at random")
    add("--runs", type=integer(1), default=3, help="scans from each distance (default: 3)")
    text = "fit planes to the inliers of RANSAC by least squares"
    add("--refit", action="store_true", help=text)
    add("--capture", type=Path, metavar="FILE", help="measure a real capture instead of scanning")
    text = "changes to the measurement (JSON, docs/reference/capture_options.md)"
    add("--capture-options", type=json_object, default={}, help=text)


@COMMANDS.register(
    "residuals",
    arguments=arguments,
    help="scan a wall and a floor: distances of the points from fitted planes",
)
def run(options: argparse.Namespace) -> dict[str, Any]:
    from jenco2022.steps.residuals import Residuals
    from puckbench.steps.capture_residuals import CaptureResiduals

    if options.capture is None:
        refuse(options, {"capture_options": {}}, "only with --capture")
        step = Residuals.create(
            errors=options.model,
            error_options=options.model_options,
            distances_m=tuple(options.distances),
            rows=options.keep,
            **selected(options, "runs", "seed", "refit"),
        )
        return step.run(options.out)
    refuse(options, _FOR_SCANS, "not with --capture")
    measuring = CaptureResiduals.create(options=options.capture_options)
    summary = measuring.run(options.capture, options.out)
    return summary if options.json else _tables(summary)


def _tables(summary: dict[str, Any]) -> dict[str, Any]:
    names = ("surface", "distance_m", "width_m", "height_m", "rows", "lasers", "std_m")
    planes = [
        {name: plane[name] for name in (*names, "laser_bias_std_m", "unevenness_m")}
        | {"ray_sigma_m": (plane["ray_noise"] or {}).get("sigma_m")}
        for plane in summary["planes"]
    ]
    rejected = [
        {name: plane[name] for name in ("surface", "distance_m", "rows", "reason")}
        for plane in summary["rejected"]
    ]
    return {**summary, "planes": planes, "rejected": rejected}
