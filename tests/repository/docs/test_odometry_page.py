"""The tables and numbers of the page on odometry are those of the shipped results."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import pandas as pd
import pytest

from pointkit.tables import read_table
from puckbench.recordings.drives import AZIMUTH, KEPT, NONE
from puckbench.report.reference_results import OF_DRIVES
from puckbench.tables.odometry_bits import odometry_bits
from puckbench.tables.odometry_differences import ALL, odometry_differences
from tests.support.bench import ROOT

PAGE = (ROOT / "docs" / "explanation" / "odometry.md").read_text(encoding="utf-8")
NAMES = {"straight": "straight", "turning": "turning", ALL: "all streets", "rooms": "rooms"}
VARIANTS = {
    ("gpcc", AZIMUTH): "`gpcc`, azimuth times",
    ("gpcc", NONE): "`gpcc`, no times",
    ("puck", KEPT): "`puck`",
}
DIGITS = {"%": 2, "mm": 1}


@cache
def drives() -> pd.DataFrame:
    return read_table(OF_DRIVES / "drives.parquet")


def bits_lines() -> Iterator[str]:
    bits = odometry_bits(drives())
    for dataset, name in NAMES.items():
        for odometry, rows in bits[bits["dataset"] == dataset].groupby("odometry", sort=False):
            by_variant = rows.set_index(["codec", "times"])
            first = rows.iloc[0]
            cells = [_needed(by_variant.loc[variant]) for variant in VARIANTS]
            before = f"{first['undecoded']:.{DIGITS[first['unit']]}f} {first['unit']}"
            shown = [f"{name} ({first['trajectories']})", odometry, before, *cells]
            yield f"| {' | '.join(shown)} |"


def _needed(row: pd.Series) -> str:
    return f"{row['bits']:.2f} ({_rate(row['rate'])})" if row["rate"] else "none"


def _rate(rate: str) -> str:
    return rate.replace("mm", " mm")


def difference_lines() -> Iterator[str]:
    table = odometry_differences(drives())
    for dataset in (ALL, "turning", "rooms"):
        for odometry in table["odometry"].unique():
            for (codec, times), variant in VARIANTS.items():
                rows = table[(table["dataset"] == dataset) & (table["odometry"] == odometry)]
                rows = rows[(rows["codec"] == codec) & (rows["times"] == times)]
                cells = [_difference(row) for _, row in rows.sort_values("bits").iterrows()]
                yield f"| {NAMES[dataset]}, {odometry} | {variant} | {' | '.join(cells)} |"


def _difference(row: pd.Series) -> str:
    digits = DIGITS[row["unit"]]
    low, middle, high = (f"{row[name]:+.{digits}f}" for name in ("low", "difference", "high"))
    return f"{middle} ({low} to {high})"


@pytest.mark.parametrize("line", [*bits_lines(), *difference_lines()])
def test_lines_of_the_tables_are_those_of_the_study(line: str) -> None:
    assert line in PAGE.splitlines()


def sentences() -> Iterator[str]:
    """Yield the parts of the page's sentences that have numbers of the study."""
    table = odometry_differences(drives()).set_index(
        ["dataset", "odometry", "codec", "times", "rate"]
    )
    table = table.sort_index()
    for odometry in ("KISS-ICP", "GICP"):
        for codec, times, rate in (
            ("gpcc", AZIMUTH, "100mm"),
            ("puck", KEPT, "100mm"),
            ("gpcc", AZIMUTH, "200mm"),
            ("puck", KEPT, "200mm"),
            ("gpcc", AZIMUTH, "500mm"),
            ("puck", KEPT, "500mm"),
        ):
            row = table.loc[(ALL, odometry, codec, times, rate)]
            yield f"{_difference(row).replace(' (', ' % (')}"
            yield f"{row['bits']:.2f} bits"
        rows = table.loc[("turning", odometry)]
        before = rows["undecoded"].iloc[0]
        untimed = rows.loc[("undecoded", NONE, "no times"), "value"]
        timed = rows.loc[("gpcc", AZIMUTH, "200mm"), "value"]
        coded = rows.loc[("gpcc", NONE, "200mm"), "value"]
        yield f"{odometry} drifts by {before:.2f} %, without times by {untimed:.2f} %"
        yield f"after `gpcc` at 200 mm by {timed:.2f} % with azimuth times, {coded:.2f} % without"
    for codec, times in (("gpcc", AZIMUTH), ("puck", KEPT)):
        row = table.loc[("rooms", "KISS-ICP", codec, times, "50mm")]
        yield f"{_difference(row).replace(' (', ' mm (')}"
        yield f"{row['bits']:.2f} bits"
    undecoded = drives()[(drives()["codec"] == "undecoded") & (drives()["times"] == KEPT)]
    in_room = undecoded["dataset"] == "rooms"
    streets, rooms = undecoded[~in_room]["length_m"], undecoded[in_room]["length_m"]
    yield f"{len(streets)} streets and {len(rooms)} rooms"
    yield f"{streets.min():.0f} to {streets.max():.0f} m in a street"
    yield f"{rooms.min():.1f} to {rooms.max():.1f} m in a room"


@pytest.mark.parametrize("words", [*sentences()])
def test_sentences_have_the_numbers_of_the_study(words: str) -> None:
    assert words in " ".join(PAGE.split())
