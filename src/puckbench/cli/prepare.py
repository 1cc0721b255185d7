"""`puckbench prepare`: from samples, clouds or scan tables to clouds ready for the codecs."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from puckbench.cli.types import whole
from puckbench.core.errors import InputError
from puckbench.core.files import read_json
from puckbench.geometry.cloud import Floats, PointCloud
from puckbench.geometry.scaling import GRID
from puckbench.io.clouds import read_cloud, write_cloud
from puckbench.jobs.preparation import Returns, prepare
from puckbench.jobs.surfaces import has_faces


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("cloud", type=Path, help="cloud (.ply) or scan table (.parquet)")
    parser.add_argument("out", type=Path, help="PLY file to write; its description goes beside it")
    parser.add_argument(
        "--crop",
        nargs="+",
        metavar="BOX",
        help="x0 y0 z0 x1 y1 z1 in metres, or a JSON file that has a 'box'",
    )
    parser.add_argument(
        "--crop-on",
        choices=("clean", "noisy"),
        default="clean",
        help="coordinates of a scan that decide (default: %(default)s)",
    )
    parser.add_argument(
        "--scale",
        type=_size,
        default=1024,
        help="size of the cube; 0: metres; grid: voxels as they came (default: 1024)",
    )
    parser.add_argument("--neighbours", type=whole(3), default=30, help="for normals (default: 30)")
    parser.add_argument("--clean", action="store_true", help="take a scan's clean coordinates")
    parser.add_argument("--truth", type=Path, help="also write the true surface points of a scan")
    parser.add_argument(
        "--about", type=Path, action="append", default=[], help="JSON whose name and group to keep"
    )


def run(options: argparse.Namespace) -> dict[str, Any]:
    """Write the prepared cloud and, if asked for, the true points in the same frame."""
    returns = _returns(options.cloud, options.clean)
    if options.crop:
        returns = returns.cropped(_box(options.crop), options.crop_on)
    if len(returns.cloud) == 0:
        raise InputError(f"{options.cloud}: no point is left after cropping")
    cloud = prepare(returns.cloud, options.scale, options.neighbours)
    about = {**_kept(options.about), **cloud.about}
    write_cloud(options.out, replace(cloud, about=about))
    if options.truth:
        write_cloud(options.truth, returns.truth_in_frame_of(cloud))
    return {**about, "points": len(cloud)}


def _size(text: str) -> int | str:
    return GRID if text == GRID else int(whole(0)(text))


def _returns(path: Path, clean: bool) -> Returns:
    if path.suffix != ".parquet":
        if has_faces(path):
            raise InputError(f"{path}: a mesh, not a cloud: sample or scan it first")
        cloud = read_cloud(path)
        return Returns(cloud, clean=cloud)
    from puckbench.lidar.scan_table import read_scan

    table = read_scan(path)
    about = {"source": path.name, **table.about}
    true = PointCloud(table.xyz, table.normals, labels=table.primitive_id, about=about)
    measured = true if clean else replace(true, xyz=table.xyz_noisy)
    return Returns(measured, clean=true)


def _box(words: list[str]) -> Floats:
    if len(words) == 1:
        box = read_json(Path(words[0])).get("box")
        if box is None:
            raise InputError(f"{words[0]}: has no 'box' to crop to")
        return np.asarray(box, dtype=np.float64)
    try:
        numbers = np.asarray([float(word) for word in words]).reshape(2, 3)
    except ValueError as error:
        raise InputError(f"--crop: six numbers or one JSON file expected, got {words}") from error
    return np.sort(numbers, axis=0)


def _kept(descriptions: list[Path]) -> dict[str, Any]:
    """Name and group of the scene, from the descriptions given."""
    kept: dict[str, Any] = {}
    for path in descriptions:
        about = read_json(path)
        kept.update({key: about[key] for key in ("name", "group") if key in about})
    return kept
