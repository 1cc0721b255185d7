"""LAS and LAZ: cut files, absurd headers, units of reference systems."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pyproj

from tests.corpus.case import Case, content
from tests.support.las_files import CRS, GEO_DOUBLES, WKT, geo_keys, las_bytes

STEPS = [(100, 200, 300), (-400, 500, 600)]
POINTS = np.array(STEPS) * 0.01
FOOT, US_FOOT = 0.3048, 1200 / 3937
FEET = "converted to metres"


def wkt(name: str) -> tuple[str, int, bytes]:
    return CRS, WKT, pyproj.CRS(name).to_wkt("WKT1_GDAL").encode() + b"\0"


def patched(at: int, layout: str, value: int) -> bytes:
    """A plain file with another number at a byte."""
    size = struct.calcsize(layout)
    return PLAIN[:at] + struct.pack(layout, value) + PLAIN[at + size :]


def laz(path: Path, point_format: int = 3, **fields: Any) -> None:
    """A compressed file by laspy, and its points."""
    header = laspy.LasHeader(point_format=point_format, version="1.4")
    header.scales = np.full(3, 0.01)
    las = laspy.LasData(header)
    las.X, las.Y, las.Z = np.array(STEPS).T
    for name, values in fields.items():
        las[name] = values
    las.write(path)


def damaged_laz(at: int, layout: str, value: int) -> Any:
    """Writes a compressed file with another number at a byte."""

    def write(path: Path) -> None:
        laz(path)
        data = bytearray(path.read_bytes())
        struct.pack_into(layout, data, at, value)
        path.write_bytes(data)

    return write


def waveforms(path: Path) -> None:
    """Points of format 4, with places of waveforms."""
    header = laspy.LasHeader(point_format=4, version="1.3")
    header.scales = np.full(3, 0.01)
    las = laspy.LasData(header)
    las.X, las.Y, las.Z = np.array(STEPS).T
    las.write(path)


def more_bytes(path: Path) -> None:
    """Points of format 1 with an extra dimension of three values, and bytes without a name."""
    header = laspy.LasHeader(point_format=1, version="1.4")
    header.scales = np.full(3, 0.01)
    header.add_extra_dim(laspy.ExtraBytesParams("amplitude", "3u1"))
    las = laspy.LasData(header)
    las.X, las.Y, las.Z = np.array(STEPS).T
    las["amplitude"] = [(1, 2, 3), (4, 5, 6)]
    las.write(path)


PLAIN = las_bytes(STEPS)
LONG_RECORD = las_bytes(STEPS, [(CRS, 1, b"x")]).replace(b"\1\0\1\0", b"\1\0\2\0", 1)

CASES = [
    Case("plain.las", content(las_bytes(STEPS)), "cloud", points=POINTS),
    Case("plain_14.las", content(las_bytes(STEPS, minor=4)), "cloud", points=POINTS),
    Case("plain.laz", laz, "cloud", points=POINTS),
    Case("waveforms.las", waveforms, "cloud", points=POINTS),
    Case(
        "extra_dimension.las",
        more_bytes,
        "cloud",
        points=POINTS,
        fields={"amplitude_0": [1, 4], "amplitude_2": [3, 6]},
    ),
    Case(
        "cut_at_a_record.las",
        content(las_bytes(STEPS, count=5)),
        "cloud",
        error="cut_at_a_record.las: .*cut short: 5 points in its header, room for 2",
    ),
    Case(
        "cut_at_a_record_14.las",
        content(las_bytes(STEPS, count=2**62, minor=4)),
        "cloud",
        error="cut short: 4611686018427387904 points",
    ),
    Case("cut_in_a_record.las", content(las_bytes(STEPS)[:-7]), "cloud", error="cut short"),
    Case("cut_in_its_header.las", content(las_bytes(STEPS)[:200]), "cloud", error="cut short"),
    Case(
        "more_points_than_it_says.las",
        content(las_bytes(STEPS, count=1)),
        "cloud",
        points=POINTS[:1],
        warning="more_points_than_it_says.las: its header says 1 points: the 1 after them are left",
    ),
    Case(
        "records_without_end.las",
        content(las_bytes(STEPS, record_count=2**32 - 1)),
        "cloud",
        error="4294967295 variable length records in 0 bytes",
    ),
    Case("long_record.las", content(LONG_RECORD), "cloud", error="records are cut short"),
    Case("no_bytes.las", content(patched(105, "<H", 0)), "cloud", error="its points have no bytes"),
    Case(
        "in_header.las", content(patched(96, "<I", 226)), "cloud", error="begin at byte 226 of 267"
    ),
    Case("beyond.las", content(patched(96, "<I", 268)), "cloud", error="begin at byte 268 of 267"),
    Case("short_header.las", content(patched(94, "<H", 226)), "cloud", error="header is cut short"),
    Case("version_2.las", content(patched(24, "<B", 2)), "cloud", error=r"version 2\.2"),
    Case("no_points.las", content(las_bytes([])), "cloud", error="the cloud is empty"),
    Case("version_9.las", content(las_bytes(STEPS, minor=9)), "cloud", error=r"version 1\.9"),
    Case(
        "chunks_of_no_points.laz",
        damaged_laz(375 + 54 + 12, "<I", 0),
        "cloud",
        error=r"chunks_of_no_points.laz: not a readable LAS file \(",
    ),
    Case(
        "chunks_of_one_point.laz",
        damaged_laz(375 + 54 + 12, "<I", 1),
        "cloud",
        error=r"chunks_of_one_point.laz: not a readable LAS file \(its parser crashes\)",
    ),
    Case(
        "huge_chunks.laz",
        damaged_laz(375 + 54 + 12, "<I", 2**32 - 2),
        "cloud",
        error=r"huge_chunks.laz: not a readable LAS file \(",
    ),
    Case(
        "items_of_no_kind.laz",
        damaged_laz(375 + 54 + 34, "<H", 0xFFFF),
        "cloud",
        error=r"items_of_no_kind.laz: not a readable LAS file \(",
    ),
    Case(
        "more_points_than_chunks.laz",
        damaged_laz(247, "<Q", 3),
        "cloud",
        error=r"more_points_than_chunks.laz: not a readable LAS file \(",
    ),
    Case(
        "us_survey_feet.las",
        content(las_bytes(STEPS, [wkt("EPSG:2225")])),
        "cloud",
        points=POINTS * US_FOOT,
        warning=f"us_survey_feet.las: its coordinates are in US survey feet: {FEET}",
    ),
    Case(
        "international_feet.las",
        content(las_bytes(STEPS, [wkt("EPSG:2222")])),
        "cloud",
        points=POINTS * FOOT,
        warning=f"in feet: {FEET}",
    ),
    Case(
        "heights_in_feet.las",
        content(las_bytes(STEPS, [wkt("EPSG:26910+8228")])),
        "cloud",
        points=POINTS * [1, 1, FOOT],
        warning=f"in metres and its heights in feet: {FEET}",
    ),
    Case("metres.las", content(las_bytes(STEPS, [wkt("EPSG:25832")])), "cloud", points=POINTS),
    Case(
        "degrees.las",
        content(las_bytes(STEPS, [wkt("EPSG:4326")])),
        "cloud",
        error="degrees.las: its coordinates are degrees: project it first",
    ),
    Case(
        "key_of_degrees.las",
        content(las_bytes(STEPS, [geo_keys((1024, 2), (2048, 4326))])),
        "cloud",
        error="its coordinates are degrees",
    ),
    Case(
        "key_of_a_system_in_feet.las",
        content(las_bytes(STEPS, [geo_keys((1024, 1), (3072, 2225))])),
        "cloud",
        points=POINTS * US_FOOT,
        warning="US survey feet",
    ),
    Case(
        "key_of_a_unit.las",
        content(las_bytes(STEPS, [geo_keys((1024, 1), (3072, 26910), (3076, 9002), (4099, 9001))])),
        "cloud",
        points=POINTS * [FOOT, FOOT, 1],
        warning="in feet and its heights in metres",
    ),
    Case(
        "key_of_a_unit_of_its_own.las",
        content(
            las_bytes(
                STEPS,
                [
                    geo_keys((1024, 1), (3072, 32767), (3076, 32767), (3077, GEO_DOUBLES, 0)),
                    (CRS, GEO_DOUBLES, struct.pack("<d", 0.001)),
                ],
            )
        ),
        "cloud",
        points=POINTS * 0.001,
        warning=r"in units of 0\.001 m",
    ),
    Case(
        "unreadable_system.las",
        content(las_bytes(STEPS, [(CRS, WKT, b"PROJCS[")])),
        "cloud",
        points=POINTS,
        warning="its coordinate reference system is not readable: metres assumed",
    ),
    Case(
        "feet_after_the_points.las",
        content(las_bytes(STEPS, minor=4, extended=[wkt("EPSG:2225")])),
        "cloud",
        points=POINTS * US_FOOT,
        warning="US survey feet",
    ),
    Case(
        "cut_after_the_points.las",
        content(las_bytes(STEPS, minor=4, extended=[wkt("EPSG:2225")])[:-1]),
        "cloud",
        error="its variable length records are cut short",
    ),
]
