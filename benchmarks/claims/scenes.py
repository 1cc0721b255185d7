"""What the scripts of the claims share: clouds of independent scenes, and verdicts on their ratios.

The rule by which a claim is judged is in docs/explanation/claims/index.md.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import pandas as pd

import puckbench
from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud
from pointkit.lidar.sensors import load_sensor
from pointkit.seeding import generator
from puckbench.codecs.base import Codec
from puckbench.metrics.statistics import MIN_SCENES, Estimate
from virtual_lidar import free_origin, open_error_model, open_sweep, returns_of_scan, scan
from virtual_lidar.scan_table import ScanTable
from virtual_lidar.scenes.rooms import make_room
from virtual_lidar.scenes.street import make_street, street_origin

MARGIN_PERCENT = 5.0
"""Difference of the bits that the rule counts as none."""
ROOMS = (
    *("Area_1_conferenceRoom_1", "Area_1_copyRoom_1", "Area_1_hallway_1", "Area_1_office_1"),
    *("Area_1_pantry_1", "Area_2_auditorium_1", "Area_2_storage_1", "Area_3_lounge_1"),
)
"""Generated rooms that trained no codec, as in config/evidence.yaml."""


def street_names(count: int) -> list[str]:
    return [f"street_{number + 1}" for number in range(count)]


def scanned(name: str, sensor: str, turns: int = 1, step_deg: float | None = None) -> ScanTable:
    """Scan a generated street (``street_1``) or room with a level sensor at rest.

    Parameters
    ----------
    name
        Name of the scene.
    sensor
        Name of the sensor, whose errors are those of `vlp16_measured`.
    turns
        Number of revolutions, ten in a second.
    step_deg
        Azimuth step; by default the sensor's.
    """
    is_street = name.startswith("street")
    mesh = make_street(name, 0, 200.0) if is_street else make_room(name, 0)
    origin = street_origin() if is_street else free_origin(mesh)
    hertz = {"rotation_hz": 10.0, "frames_per_second": 10.0, "duration_s": turns / 10}
    sweep = open_sweep({"preset": "spin", "azimuth_step_deg": step_deg, **hertz})
    errors = open_error_model("vlp16_measured", None)
    return scan(mesh, load_sensor(sensor), sweep, errors, origin, generator(1, "claims", name))


def turn_of(name: str, sensor: str, step_deg: float | None = None) -> PointCloud:
    """Return one scanned turn with its returns and normals, in m in the sensor's coordinates."""
    returns = returns_of_scan(scanned(name, sensor, step_deg=step_deg)).returns
    return prepared(PointCloud(returns.points(), returns=returns))


def prepared(cloud: PointCloud) -> PointCloud:
    """Return a cloud in metres with normals, which D2 needs, and its returns."""
    return replace(puckbench.prepare(cloud, 0), returns=cloud.returns)


def bd_ratios(table: pd.DataFrame, anchor: str, qualities: Iterable[str]) -> pd.DataFrame:
    """Return the ratios of bits of every codec to the anchor's at equal quality.

    Parameters
    ----------
    table
        Rows of `puckbench.compare` for one cloud.
    anchor
        Name of the codec that the others are compared with.
    qualities
        Columns that measure quality.

    Returns
    -------
    pandas.DataFrame
        Columns ``codec``, ``quality`` and ``ratio``; pairs whose curves share too little are left
        out.
    """
    by_codec = {str(name): part for name, part in table.groupby("codec", sort=False)}
    rows = []
    for quality in qualities:
        for codec in [name for name in by_codec if name != anchor]:
            try:
                delta = puckbench.bd_rate(by_codec[anchor], by_codec[codec], quality)
            except InputError as error:
                print(f"  {codec} {quality}: {error}")
                continue
            rows.append({"codec": codec, "quality": quality, "ratio": 1 + delta / 100})
    return pd.DataFrame(rows, columns=["codec", "quality", "ratio"])


def report(title: str, ratios: Mapping[str, Iterable[float]]) -> None:
    """Print the estimate and the verdict of each named list of ratios, one for each scene."""
    print(f"\n{title}")
    for name, values in ratios.items():
        print(f"  {name}: {ratio_text(values)}")


def ratio_text(values: Iterable[float]) -> str:
    """Return ratios (n,), one for each scene, in words: mean, interval or extremes, verdict."""
    found = Estimate.of_ratios(values)
    ends = f"{found.least:.3f} to {found.most:.3f} in the scenes"
    if found.scenes >= MIN_SCENES:
        ends = f"{found.low:.3f} to {found.high:.3f}"
    difference = replace(
        found, **{end: 100 * (getattr(found, end) - 1) for end in ("mean", "low", "high")}
    )
    verdict = difference.verdict(MARGIN_PERCENT)
    return f"{found.mean:.3f} ({ends}), {found.scenes} scenes, {verdict}"


def opened(*names: str, **changes: dict[str, object]) -> list[Codec]:
    """Open codecs by name, with changes to some of them."""
    return [puckbench.open_codec(name, changes.get(name)) for name in names]
