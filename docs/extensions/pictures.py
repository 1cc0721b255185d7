"""Pictures of the documentation, of the shipped reference results and the default run's clouds.

    python docs/extensions/pictures.py [NAME ...] [--results results] [--out docs/pictures]

`make pages` makes the clouds first. A picture carries the digests of its data, which a test
compares with those of the shipped results.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from PIL import Image
from PIL.PngImagePlugin import PngInfo
from primitives_picture import draw_primitives

from cloud_files.clouds import read_cloud
from cloud_files.meshes.reading import read_mesh
from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud
from puckbench.figures.drawing import lay_out, save_figure
from puckbench.figures.registry import figure_entry
from puckbench.figures.style import FigureStyle
from puckbench.metrics.coordinate_frames import rows_in_frame
from puckbench.report.reference_results import (
    DIGEST,
    FOLDER,
    OF_DRIVES,
    ReferenceResults,
    read_reference,
)
from puckbench.tables.registry import table_entry

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

PICTURES_FOLDER = Path(__file__).parents[1] / "pictures"
KEY = "puckbench"
"""Name of the text in a PNG file that has the figure and the digests of its data."""
DRIVES = "drives"
_DPI, _COLOURS = 200, 256


@dataclass(frozen=True)
class Picture:
    """A registered figure of a study's tables, or of example clouds of its configuration.

    `only` has the values to draw, by column of the tables.
    """

    figure: str
    study: str
    examples: tuple[str, ...] = ()
    only: Mapping[str, tuple[str, ...]] = field(default_factory=dict)


PICTURES = {
    "rooms": Picture("fig_6_3", "default", ("raw", "clean", "noisy")),
    "truth": Picture("truth_rd", "default"),
    "primitives": Picture("primitives", "default", ("noisy",)),
    "noise_cost": Picture("noise_cost", "evidence"),
    "handicap": Picture(
        "handicap",
        "sweeps",
        only={
            "dataset": ("rooms", "streets", "streets_hdl64e"),
            "codec": ("gpcc", "gpcc_angular", "gpcc_predictive", "sparse_octree_net", "puck"),
        },
    ),
    "odometry": Picture("odometry", DRIVES),
    "perception": Picture("perception", "perception"),
}
NOT_SHIPPED = {"attributes": "of recordings (config/attributes.yaml)"}
"""Pictures of results that are not shipped, and of what."""


def study_file(study: str) -> Path:
    folder = OF_DRIVES if study == DRIVES else FOLDER
    return folder / f"{study}.parquet"


def stamp(picture: Picture) -> str:
    """Return the figure and the digests of its data, as JSON: of clouds or of a study's file."""
    if picture.examples:
        data = example_digests(read_reference(picture.study), picture.examples)
    else:
        path = study_file(picture.study)
        data = {path.name: hashlib.sha256(path.read_bytes()).hexdigest()}
    return json.dumps({"figure": picture.figure, "data": data}, sort_keys=True)


def stamp_in(path: Path) -> str | None:
    with Image.open(path) as image:
        text: str | None = image.info.get(KEY)
    return text


def example_digests(reference: ReferenceResults, examples: tuple[str, ...]) -> dict[str, str]:
    """Return the digest of each example cloud, by ``dataset/cloud``."""
    rows = reference.metrics[["dataset", "cloud", DIGEST]].drop_duplicates()
    digests = {f"{dataset}/{cloud}": str(d) for dataset, cloud, d in rows.itertuples(index=False)}
    names = reference.about["configuration"]["figures"]["examples"]
    return {names[example]: digests[names[example]] for example in examples}


def draw(picture: Picture, style: FigureStyle, results: Path) -> Figure:
    if picture.examples:
        return _draw_clouds(picture, style, results)
    entry = figure_entry(picture.figure)
    tables = {name: rows_in_frame(_table(picture, name), entry.frame) for name in entry.inputs}
    for column, values in picture.only.items():
        tables = {
            name: table[table[column].isin(values)] if column in table else table
            for name, table in tables.items()
        }
    figure: Figure = entry.draw(**tables, style=style)
    return figure


def _table(picture: Picture, name: str) -> pd.DataFrame:
    from pointkit.tables import read_table

    if picture.study == DRIVES:
        drives = read_table(study_file(DRIVES))
        return drives if name == DRIVES else table_entry(name).make(drives=drives)
    reference = read_reference(picture.study)
    if name == "perception_losses":
        return table_entry(name).make(metrics=reference.metrics, clouds=reference.table("clouds"))
    table = reference.metrics if name == "metrics" else reference.table(name)
    if table is None:
        raise InputError(f"reference results {picture.study}: no table {name}")
    return table


def _draw_clouds(picture: Picture, style: FigureStyle, results: Path) -> Figure:
    reference = read_reference(picture.study)
    digests = example_digests(reference, picture.examples)
    clouds = [_cloud(results / "clouds" / f"{name}.ply", digests[name]) for name in digests]
    if picture.figure == "primitives":
        dataset, _, cloud = next(iter(digests)).partition("/")
        scene_set = reference.about["configuration"]["datasets"][dataset]["scene_set"]
        scene = results / "scenes" / scene_set / f"{cloud}.ply"
        return draw_primitives(clouds[0], read_mesh(scene))
    names = [f"example_{example}" for example in picture.examples]
    figure: Figure = figure_entry(picture.figure).draw(
        **dict(zip(names, clouds, strict=True)), style=style
    )
    return figure


def _cloud(path: Path, digest: str) -> PointCloud:
    cloud = read_cloud(path)
    if cloud.about.get("digest") != digest:
        raise InputError(f"{path}: not the cloud of the reference results (see `make reference`)")
    return cloud


def style_of(study: str) -> FigureStyle:
    from pointkit.column_tables import parquet_metadata
    from puckbench.report.reference_results import KEY as ABOUT

    if study != DRIVES:
        return read_reference(study).style
    about = json.loads(parquet_metadata(study_file(study))[ABOUT.encode()])
    return FigureStyle.from_config(*about["style"])


def write_picture(name: str, path: Path, results: Path) -> None:
    picture = PICTURES[name]
    style = style_of(picture.study).model_copy(update={"dpi": _DPI})
    with style.context():
        figure = draw(picture, style, results)
        lay_out(figure)
        save_figure(figure, path)
    text = PngInfo()
    text.add_text(KEY, stamp(picture))
    with Image.open(path) as image:
        small = image.convert("RGB").quantize(_COLOURS, Image.Quantize.MAXCOVERAGE)
    small.save(path, optimize=True, pnginfo=text)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(PICTURES))
    parser.add_argument("--results", type=Path, default=Path("results"))
    parser.add_argument("--out", type=Path, default=PICTURES_FOLDER)
    options = parser.parse_args()
    if unknown := set(options.names) - PICTURES.keys():
        parser.error(f"no picture {', '.join(sorted(unknown))} (known: {', '.join(PICTURES)})")
    for name in options.names or PICTURES:
        path = options.out / f"{name}.png"
        write_picture(name, path, options.results)
        sys.stdout.write(f"{path}\n")


if __name__ == "__main__":
    main()
