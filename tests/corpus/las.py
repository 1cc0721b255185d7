"""LAS and LAZ: cut files, absurd headers, units of reference systems."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pyproj

from tests.corpus.case import Case, content
from tests.support.las_files import (
    CRS,
    GEO_DOUBLES,
    WKT,
    extra_bytes,
    geo_keys,
    las_bytes,
    patched,
    with_bytes,
    with_extra_bytes,
)

STEPS = [(100, 200, 300), (-400, 500, 600)]
POINTS = np.array(STEPS) * 0.01
FOOT, US_FOOT = 0.3048, 1200 / 3937
FEET = "converted to metres"


def wkt(name: str) -> tuple[str, int, bytes]:
    return CRS, WKT, pyproj.CRS(name).to_wkt("WKT1_GDAL").encode() + b"\0"


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


def by_laspy(point_format: int, version: str = "1.4", **fields: Any) -> Callable[[Path], None]:
    """Writes points by laspy, compressed by the name's suffix; `records` are user-defined ones."""

    def write(path: Path) -> None:
        header = laspy.LasHeader(point_format=point_format, version=version)
        header.scales = np.full(3, 0.01)
        header.vlrs.extend(fields.pop("records", ()))
        las = laspy.LasData(header)
        las.X, las.Y, las.Z = np.array(STEPS).T
        for name, values in fields.items():
            las[name] = values
        las.write(path)

    return write


def streamed(path: Path) -> None:
    """A compressed file by a program that could not go back to set the chunk table's place."""
    laz(path)
    data = path.read_bytes()
    (begin,) = struct.unpack_from("<I", data, 96)
    (table,) = struct.unpack_from("<q", data, begin)
    path.write_bytes(patched(data + struct.pack("<q", table), begin, "<q", -1))


def cut_laz(path: Path) -> None:
    laz(path)
    path.write_bytes(path.read_bytes()[:-3])


def waves_inside(path: Path) -> None:
    """Points of format 4, and waveforms behind them, which are no points."""
    waveforms(path)
    data = path.read_bytes()
    record = struct.pack("<2x16sHQ32x", b"LASF_Spec", 65535, 200) + bytes(200)
    path.write_bytes(patched(data, 227, "<Q", len(data)) + record)


def in_millimetres() -> bytes:
    """A reference system in millimetres."""
    metre = 'UNIT["metre",1,AUTHORITY["EPSG","9001"]]'
    text = pyproj.CRS("EPSG:25832").to_wkt("WKT1_GDAL").replace(metre, 'UNIT["millimetre",0.001]')
    return las_bytes(STEPS, [(CRS, WKT, text.encode())])


def in_latin() -> bytes:
    """A reference system in feet, with a name in Latin-1."""
    user, number, text = wkt("EPSG:2222")
    return las_bytes(STEPS, [(user, number, text.replace(b"Arizona", b"Arizon\xe4"))])


PLAIN = las_bytes(STEPS)
PLAIN_14 = las_bytes(STEPS, minor=4)
INTENSITY = {"intensity": [7, 7]}
READABLE = "not a readable LAS file"
NO_UNIT = "its coordinate reference system states no unit: metres assumed"
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
    Case(
        "no_bytes.las",
        content(patched(PLAIN, 105, "<H", 0)),
        "cloud",
        error="its points have no bytes",
    ),
    Case(
        "in_header.las",
        content(patched(PLAIN, 96, "<I", 226)),
        "cloud",
        error="begin at byte 226 of 267",
    ),
    Case(
        "beyond.las",
        content(patched(PLAIN, 96, "<I", 268)),
        "cloud",
        error="begin at byte 268 of 267",
    ),
    Case(
        "short_header.las",
        content(patched(PLAIN, 94, "<H", 226)),
        "cloud",
        error="header is cut short",
    ),
    Case("version_2.las", content(patched(PLAIN, 24, "<B", 2)), "cloud", error=r"version 2\.2"),
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
    # Kinds of files in bug reports of laspy, PDAL, LAStools, CloudCompare and laz-rs.
    Case("las_1_0.las", content(las_bytes(STEPS, minor=0)), "cloud", points=POINTS),
    Case(
        "las_1_0_with_marker.las",
        content(with_bytes(las_bytes(STEPS, minor=0), 227, b"\xdd\xcc")),
        "cloud",
        points=POINTS,
        fields=INTENSITY,
    ),
    Case(
        "bytes_before_its_points.las",
        content(with_bytes(PLAIN, 227, bytes(range(256)) * 8)),
        "cloud",
        points=POINTS,
        fields=INTENSITY,
    ),
    Case(
        "longer_header.las",
        content(patched(with_bytes(PLAIN, 227, b"u" * 50), 94, "<H", 277)),
        "cloud",
        points=POINTS,
    ),
    Case(
        "short_header_of_1_3.las",
        content(patched(PLAIN, 25, "<B", 3)),
        "cloud",
        error=rf"{READABLE} \(its header is cut short\)",
    ),
    Case(
        "one_record_less_than_it_says.las",
        content(las_bytes(STEPS, [(CRS, 1, b"x" * 10)], record_count=2)),
        "cloud",
        error="2 variable length records in 64 bytes",
    ),
    Case("point_format_11.las", content(patched(PLAIN, 104, "<B", 11)), "cloud", error="format 11"),
    Case(
        "short_points.las",
        content(patched(PLAIN, 105, "<H", 18)),
        "cloud",
        error="Incoherent point size, header says 18",
    ),
    Case(
        "count_in_a_legacy_field_alone.las",
        content(patched(PLAIN_14, 247, "<Q", 0)),
        "cloud",
        error="its header says 0 points, and 2 in a legacy field",
    ),
    Case("no_legacy_count.las", content(patched(PLAIN_14, 107, "<I", 0)), "cloud", points=POINTS),
    Case(
        "other_legacy_count.las", content(patched(PLAIN_14, 107, "<I", 9)), "cloud", points=POINTS
    ),
    Case(
        "wrong_counts_by_return.las",
        content(patched(PLAIN, 111, "<5I", 9, 9, 9, 9, 9)),
        "cloud",
        points=POINTS,
    ),
    Case(
        "wrong_bounds.las",
        content(patched(PLAIN, 179, "<6d", 1, 2, 3, 4, 5, math.nan)),
        "cloud",
        points=POINTS,
    ),
    Case("no_date.las", content(patched(PLAIN, 90, "<HH", 0, 0)), "cloud", points=POINTS),
    Case("day_400.las", content(patched(PLAIN, 90, "<HH", 400, 2000)), "cloud", points=POINTS),
    Case("scale_of_0.las", content(patched(PLAIN, 131, "<d", 0)), "cloud", error="a scale is 0"),
    Case(
        "scale_that_is_no_number.las",
        content(patched(PLAIN, 139, "<d", math.nan)),
        "cloud",
        error="a scale or an offset is not finite",
    ),
    Case(
        "infinite_offset.las",
        content(patched(PLAIN, 171, "<d", math.inf)),
        "cloud",
        error="a scale or an offset is not finite",
    ),
    Case(
        "scales_and_offsets_of_each_axis.las",
        content(patched(PLAIN, 131, "<6d", -0.01, 0.002, 0.25, 1e6, -5e6, 0.5)),
        "cloud",
        points=[(999_999, -4_999_999.6, 75.5), (1_000_004, -4_999_999, 150.5)],
    ),
    Case("records_at_the_end.las", content(patched(PLAIN_14, 235, "<QI", 415, 0)), "cloud", POINTS),
    Case(
        "records_beyond_the_end.las",
        content(patched(PLAIN_14, 235, "<QI", 10**9, 1)),
        "cloud",
        error="1 variable length records in 0 bytes",
    ),
    Case(
        "described_bytes_that_its_points_lack.las",
        content(las_bytes(STEPS, [extra_bytes(b"amplitude", 3)])),
        "cloud",
        points=POINTS,
        warning="its points lack the extra bytes that a record describes",
    ),
    Case(
        "more_described_than_its_points_have.las",
        content(
            with_extra_bytes(las_bytes(STEPS, [extra_bytes(b"amplitude", 5)]), [b"\1\2", b"\3\4"])
        ),
        "cloud",
        error="Incoherent point size, header says 22 point_format created says 24",
    ),
    Case(
        "bytes_without_description.las",
        content(with_extra_bytes(PLAIN, [b"\1\2", b"\4\5"])),
        "cloud",
        points=POINTS,
        fields={"ExtraBytes_0": [1, 4], "ExtraBytes_1": [2, 5]},
    ),
    Case(
        "two_records_of_extra_bytes.las",
        content(
            with_extra_bytes(
                las_bytes(STEPS, [extra_bytes(b"amplitude", 3), extra_bytes(b"deviation", 1)]),
                [b"\1\0\7", b"\2\0\x09"],
            )
        ),
        "cloud",
        points=POINTS,
        fields={"amplitude": [1, 2], "ExtraBytes": [7, 9]},
    ),
    Case(
        "extra_bytes_with_scale_and_offset.las",
        content(
            with_extra_bytes(
                las_bytes(STEPS, [extra_bytes(b"amplitude", 3, 8 | 16, 0.5, 5.0)]),
                [b"\1\0", b"\xff\xff"],
            )
        ),
        "cloud",
        points=POINTS,
        fields={"amplitude": [5.5, 32772.5]},
    ),
    Case(
        "extra_dimension_named_x.las",
        content(with_extra_bytes(las_bytes(STEPS, [extra_bytes(b"x", 3)]), [b"\1\0", b"\2\0"])),
        "cloud",
        points=POINTS,
        fields={"x_": [1, 2]},
    ),
    Case(
        "extra_dimension_named_twice.las",
        content(
            with_extra_bytes(las_bytes(STEPS, [extra_bytes(b"intensity", 3)]), [b"\1\0", b"\2\0"])
        ),
        "cloud",
        error="field 'intensity' occurs more than once",
    ),
    Case(
        "class_200.laz",
        by_laspy(6, classification=[200, 3], scan_angle=[-15000, 30000]),
        "cloud",
        points=POINTS,
        fields={"classification": [200, 3], "scan_angle": [-15000, 30000]},
    ),
    Case(
        "infrared.las",
        by_laspy(8, red=[65535, 1], green=[1, 2], blue=[3, 4], nir=[5, 60000]),
        "cloud",
        points=POINTS,
        fields={"nir": [5, 60000], "red_16": [65535, 1], "blue_16": [3, 4]},
    ),
    Case("waveforms.laz", by_laspy(9, x_t=[0.5, 2]), "cloud", POINTS, fields={"x_t": [0.5, 2]}),
    Case("waveforms_behind_its_points.las", waves_inside, "cloud", points=POINTS),
    Case("chunk_table_at_the_end.laz", streamed, "cloud", points=POINTS),
    Case("cut.laz", cut_laz, "cloud", error=f"{READABLE} .*failed to fill whole buffer"),
    Case(
        "of_copc.laz",
        by_laspy(6, records=[laspy.VLR("copc", 1, "", bytes(160))]),
        "cloud",
        points=POINTS,
    ),
    Case("millimetres.las", content(in_millimetres()), "cloud", POINTS * 0.001, None, r"0\.001 m"),
    Case("feet_of_a_name_in_latin.las", content(in_latin()), "cloud", POINTS * FOOT, None, FEET),
    Case(
        "site_in_us_feet.las",
        content(las_bytes(STEPS, [(CRS, WKT, b'LOCAL_CS["a",UNIT["US foot",0.304800609601219]]')])),
        "cloud",
        points=POINTS * US_FOOT,
        warning="US survey feet",
    ),
    Case("geocentric.las", content(las_bytes(STEPS, [wkt("EPSG:4978")])), "cloud", points=POINTS),
    Case(
        "empty_system.las", content(las_bytes(STEPS, [(CRS, WKT, b"\0")])), "cloud", points=POINTS
    ),
    Case(
        "feet_after_the_points_and_keys_in_metres.las",
        content(las_bytes(STEPS, [geo_keys((3072, 25832))], minor=4, extended=[wkt("EPSG:2222")])),
        "cloud",
        points=POINTS * FOOT,
        warning=FEET,
    ),
    Case(
        "key_of_an_unknown_system.las",
        content(las_bytes(STEPS, [geo_keys((1024, 1), (3072, 60000))])),
        "cloud",
        points=POINTS,
        warning=NO_UNIT,
    ),
    Case(
        "key_of_a_unit_that_is_lost.las",
        content(las_bytes(STEPS, [geo_keys((3072, 32767), (3076, 32767), (3077, GEO_DOUBLES, 0))])),
        "cloud",
        points=POINTS,
        warning=NO_UNIT,
    ),
    Case(
        "keys_cut_short.las",
        content(las_bytes(STEPS, [(CRS, 34735, geo_keys((1024, 1), (3072, 2225))[2][:-3])])),
        "cloud",
        points=POINTS,
        warning=NO_UNIT,
    ),
]
