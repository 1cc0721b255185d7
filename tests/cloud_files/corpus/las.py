"""LAS and LAZ: cut files, absurd headers, units of reference systems."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pyproj

from tests.support.corpus_case import Case, cloud_case
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


def _case(
    file: str,
    data: bytes | Callable[[Path], Any],
    points: Any = POINTS,
    error: str | None = None,
    **more: Any,
) -> Case:
    return cloud_case(file, data, points, error, **more)


def wkt(name: str) -> tuple[str, int, bytes]:
    return CRS, WKT, pyproj.CRS(name).to_wkt("WKT1_GDAL").encode() + b"\0"


def by_laspy(
    point_format: int = 3,
    version: str = "1.4",
    records: Sequence[laspy.VLR] = (),
    extra: Sequence[laspy.ExtraBytesParams] = (),
    **fields: Any,
) -> Callable[[Path], None]:
    """Return a function that writes points by laspy, compressed if the file is named .laz."""

    def write(path: Path) -> None:
        header = laspy.LasHeader(point_format=point_format, version=version)
        header.scales = np.full(3, 0.01)
        header.vlrs.extend(records)
        header.add_extra_dims(list(extra))
        las = laspy.LasData(header)
        las.X, las.Y, las.Z = np.array(STEPS).T
        for name, values in fields.items():
            las[name] = values
        las.write(path)

    return write


LAZ = by_laspy()
WAVEFORMS = by_laspy(4, "1.3")
"""Points of format 4, with places of waveforms."""
MORE_BYTES = by_laspy(
    1, extra=[laspy.ExtraBytesParams("amplitude", "3u1")], amplitude=[(1, 2, 3), (4, 5, 6)]
)
"""Points of format 1 with an extra dimension of three values."""


def damaged_laz(at: int, layout: str, value: int) -> Callable[[Path], None]:
    """Return a function that writes a compressed file with another number at a byte."""

    def write(path: Path) -> None:
        LAZ(path)
        path.write_bytes(patched(path.read_bytes(), at, layout, value))

    return write


def streamed(path: Path) -> None:
    """A compressed file by a program that could not go back to set the chunk table's place."""
    LAZ(path)
    data = path.read_bytes()
    (begin,) = struct.unpack_from("<I", data, 96)
    (table,) = struct.unpack_from("<q", data, begin)
    path.write_bytes(patched(data + struct.pack("<q", table), begin, "<q", -1))


def cut_laz(path: Path) -> None:
    LAZ(path)
    path.write_bytes(path.read_bytes()[:-3])


def waves_inside(path: Path) -> None:
    """Points of format 4, and waveforms behind them, which are no points."""
    WAVEFORMS(path)
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
    _case("plain.las", las_bytes(STEPS)),
    _case("plain_14.las", las_bytes(STEPS, minor=4)),
    _case("plain.laz", LAZ),
    _case("waveforms.las", WAVEFORMS),
    _case("extra_dimension.las", MORE_BYTES, fields={"amplitude_0": [1, 4], "amplitude_2": [3, 6]}),
    _case(
        "cut_at_a_record.las",
        las_bytes(STEPS, count=5),
        error="cut_at_a_record.las: .*cut short: 5 points in its header, room for 2",
    ),
    _case(
        "cut_at_a_record_14.las",
        las_bytes(STEPS, count=2**62, minor=4),
        error="cut short: 4611686018427387904 points",
    ),
    _case("cut_in_a_record.las", las_bytes(STEPS)[:-7], error="cut short"),
    _case("cut_in_its_header.las", las_bytes(STEPS)[:200], error="cut short"),
    _case(
        "more_points_than_it_says.las",
        las_bytes(STEPS, count=1),
        POINTS[:1],
        warning="more_points_than_it_says.las: its header says 1 points: the 1 after them are left",
    ),
    _case(
        "records_without_end.las",
        las_bytes(STEPS, record_count=2**32 - 1),
        error="4294967295 variable length records in 0 bytes",
    ),
    _case("long_record.las", LONG_RECORD, error="records are cut short"),
    _case("no_bytes.las", patched(PLAIN, 105, "<H", 0), error="its points have no bytes"),
    _case("in_header.las", patched(PLAIN, 96, "<I", 226), error="begin at byte 226 of 267"),
    _case("beyond.las", patched(PLAIN, 96, "<I", 268), error="begin at byte 268 of 267"),
    _case("short_header.las", patched(PLAIN, 94, "<H", 226), error="header is cut short"),
    _case("version_2.las", patched(PLAIN, 24, "<B", 2), error=r"version 2\.2"),
    _case("no_points.las", las_bytes([]), error="the cloud is empty"),
    _case("version_9.las", las_bytes(STEPS, minor=9), error=r"version 1\.9"),
    _case(
        "chunks_of_no_points.laz",
        damaged_laz(375 + 54 + 12, "<I", 0),
        error=r"chunks_of_no_points.laz: not a readable LAS file \(",
    ),
    _case(
        "chunks_of_one_point.laz",
        damaged_laz(375 + 54 + 12, "<I", 1),
        error=r"chunks_of_one_point.laz: not a readable LAS file \(its parser crashes\)",
    ),
    _case(
        "huge_chunks.laz",
        damaged_laz(375 + 54 + 12, "<I", 2**32 - 2),
        error=r"huge_chunks.laz: not a readable LAS file \(",
    ),
    _case(
        "items_of_no_kind.laz",
        damaged_laz(375 + 54 + 34, "<H", 0xFFFF),
        error=r"items_of_no_kind.laz: not a readable LAS file \(",
    ),
    _case(
        "more_points_than_chunks.laz",
        damaged_laz(247, "<Q", 3),
        error=r"more_points_than_chunks.laz: not a readable LAS file \(",
    ),
    _case(
        "us_survey_feet.las",
        las_bytes(STEPS, [wkt("EPSG:2225")]),
        POINTS * US_FOOT,
        warning=f"us_survey_feet.las: its coordinates are in US survey feet: {FEET}",
    ),
    _case(
        "international_feet.las",
        las_bytes(STEPS, [wkt("EPSG:2222")]),
        POINTS * FOOT,
        warning=f"in feet: {FEET}",
    ),
    _case(
        "heights_in_feet.las",
        las_bytes(STEPS, [wkt("EPSG:26910+8228")]),
        POINTS * [1, 1, FOOT],
        warning=f"in metres and its heights in feet: {FEET}",
    ),
    _case("metres.las", las_bytes(STEPS, [wkt("EPSG:25832")])),
    _case(
        "degrees.las",
        las_bytes(STEPS, [wkt("EPSG:4326")]),
        error="degrees.las: its coordinates are degrees: project it first",
    ),
    _case(
        "key_of_degrees.las",
        las_bytes(STEPS, [geo_keys((1024, 2), (2048, 4326))]),
        error="its coordinates are degrees",
    ),
    _case(
        "key_of_a_system_in_feet.las",
        las_bytes(STEPS, [geo_keys((1024, 1), (3072, 2225))]),
        POINTS * US_FOOT,
        warning="US survey feet",
    ),
    _case(
        "key_of_a_unit.las",
        las_bytes(STEPS, [geo_keys((1024, 1), (3072, 26910), (3076, 9002), (4099, 9001))]),
        POINTS * [FOOT, FOOT, 1],
        warning="in feet and its heights in metres",
    ),
    _case(
        "key_of_a_unit_of_its_own.las",
        las_bytes(
            STEPS,
            [
                geo_keys((1024, 1), (3072, 32767), (3076, 32767), (3077, GEO_DOUBLES, 0)),
                (CRS, GEO_DOUBLES, struct.pack("<d", 0.001)),
            ],
        ),
        POINTS * 0.001,
        warning=r"in units of 0\.001 m",
    ),
    _case(
        "unreadable_system.las",
        las_bytes(STEPS, [(CRS, WKT, b"PROJCS[")]),
        warning="its coordinate reference system is not readable: metres assumed",
    ),
    _case(
        "feet_after_the_points.las",
        las_bytes(STEPS, minor=4, extended=[wkt("EPSG:2225")]),
        POINTS * US_FOOT,
        warning="US survey feet",
    ),
    _case(
        "cut_after_the_points.las",
        las_bytes(STEPS, minor=4, extended=[wkt("EPSG:2225")])[:-1],
        error="its variable length records are cut short",
    ),
    # Kinds of files in bug reports of laspy, PDAL, LAStools, CloudCompare and laz-rs.
    _case("las_1_0.las", las_bytes(STEPS, minor=0)),
    _case(
        "las_1_0_with_marker.las",
        with_bytes(las_bytes(STEPS, minor=0), 227, b"\xdd\xcc"),
        fields=INTENSITY,
    ),
    _case(
        "bytes_before_its_points.las",
        with_bytes(PLAIN, 227, bytes(range(256)) * 8),
        fields=INTENSITY,
    ),
    _case("longer_header.las", patched(with_bytes(PLAIN, 227, b"u" * 50), 94, "<H", 277)),
    _case(
        "short_header_of_1_3.las",
        patched(PLAIN, 25, "<B", 3),
        error=rf"{READABLE} \(its header is cut short\)",
    ),
    _case(
        "one_record_less_than_it_says.las",
        las_bytes(STEPS, [(CRS, 1, b"x" * 10)], record_count=2),
        error="2 variable length records in 64 bytes",
    ),
    _case("point_format_11.las", patched(PLAIN, 104, "<B", 11), error="format 11"),
    _case(
        "short_points.las",
        patched(PLAIN, 105, "<H", 18),
        error="Incoherent point size, header says 18",
    ),
    _case(
        "count_in_a_legacy_field_alone.las",
        patched(PLAIN_14, 247, "<Q", 0),
        error="its header says 0 points, and 2 in a legacy field",
    ),
    _case("no_legacy_count.las", patched(PLAIN_14, 107, "<I", 0)),
    _case("other_legacy_count.las", patched(PLAIN_14, 107, "<I", 9)),
    _case("wrong_counts_by_return.las", patched(PLAIN, 111, "<5I", 9, 9, 9, 9, 9)),
    _case("wrong_bounds.las", patched(PLAIN, 179, "<6d", 1, 2, 3, 4, 5, math.nan)),
    _case("no_date.las", patched(PLAIN, 90, "<HH", 0, 0)),
    _case("day_400.las", patched(PLAIN, 90, "<HH", 400, 2000)),
    _case("scale_of_0.las", patched(PLAIN, 131, "<d", 0), error="a scale is 0"),
    _case(
        "scale_that_is_no_number.las",
        patched(PLAIN, 139, "<d", math.nan),
        error="a scale or an offset is not finite",
    ),
    _case(
        "infinite_offset.las",
        patched(PLAIN, 171, "<d", math.inf),
        error="a scale or an offset is not finite",
    ),
    _case(
        "scales_and_offsets_of_each_axis.las",
        patched(PLAIN, 131, "<6d", -0.01, 0.002, 0.25, 1e6, -5e6, 0.5),
        [(999_999, -4_999_999.6, 75.5), (1_000_004, -4_999_999, 150.5)],
    ),
    _case("records_at_the_end.las", patched(PLAIN_14, 235, "<QI", 415, 0)),
    _case(
        "records_beyond_the_end.las",
        patched(PLAIN_14, 235, "<QI", 10**9, 1),
        error="1 variable length records in 0 bytes",
    ),
    _case(
        "described_bytes_that_its_points_lack.las",
        las_bytes(STEPS, [extra_bytes(b"amplitude", 3)]),
        warning="its points lack the extra bytes that a record describes",
    ),
    _case(
        "more_described_than_its_points_have.las",
        with_extra_bytes(las_bytes(STEPS, [extra_bytes(b"amplitude", 5)]), [b"\1\2", b"\3\4"]),
        error="Incoherent point size, header says 22 point_format created says 24",
    ),
    _case(
        "bytes_without_description.las",
        with_extra_bytes(PLAIN, [b"\1\2", b"\4\5"]),
        fields={"ExtraBytes_0": [1, 4], "ExtraBytes_1": [2, 5]},
    ),
    _case(
        "two_records_of_extra_bytes.las",
        with_extra_bytes(
            las_bytes(STEPS, [extra_bytes(b"amplitude", 3), extra_bytes(b"deviation", 1)]),
            [b"\1\0\7", b"\2\0\x09"],
        ),
        fields={"amplitude": [1, 2], "ExtraBytes": [7, 9]},
    ),
    _case(
        "extra_bytes_with_scale_and_offset.las",
        with_extra_bytes(
            las_bytes(STEPS, [extra_bytes(b"amplitude", 3, 8 | 16, 0.5, 5.0)]),
            [b"\1\0", b"\xff\xff"],
        ),
        fields={"amplitude": [5.5, 32772.5]},
    ),
    _case(
        "extra_dimension_named_x.las",
        with_extra_bytes(las_bytes(STEPS, [extra_bytes(b"x", 3)]), [b"\1\0", b"\2\0"]),
        fields={"x_": [1, 2]},
    ),
    _case(
        "extra_dimension_named_twice.las",
        with_extra_bytes(las_bytes(STEPS, [extra_bytes(b"intensity", 3)]), [b"\1\0", b"\2\0"]),
        error="field 'intensity' occurs more than once",
    ),
    _case(
        "class_200.laz",
        by_laspy(6, classification=[200, 3], scan_angle=[-15000, 30000]),
        fields={"classification": [200, 3], "scan_angle": [-15000, 30000]},
    ),
    _case(
        "infrared.las",
        by_laspy(8, red=[65535, 1], green=[1, 2], blue=[3, 4], nir=[5, 60000]),
        fields={"nir": [5, 60000], "red_16": [65535, 1], "blue_16": [3, 4]},
    ),
    _case("waveforms.laz", by_laspy(9, x_t=[0.5, 2]), fields={"x_t": [0.5, 2]}),
    _case("waveforms_behind_its_points.las", waves_inside),
    _case("chunk_table_at_the_end.laz", streamed),
    _case("cut.laz", cut_laz, error=f"{READABLE} .*failed to fill whole buffer"),
    _case("of_copc.laz", by_laspy(6, records=[laspy.VLR("copc", 1, "", bytes(160))])),
    _case("millimetres.las", in_millimetres(), POINTS * 0.001, warning=r"0\.001 m"),
    _case("feet_of_a_name_in_latin.las", in_latin(), POINTS * FOOT, warning=FEET),
    _case(
        "site_in_us_feet.las",
        las_bytes(STEPS, [(CRS, WKT, b'LOCAL_CS["a",UNIT["US foot",0.304800609601219]]')]),
        POINTS * US_FOOT,
        warning="US survey feet",
    ),
    _case("geocentric.las", las_bytes(STEPS, [wkt("EPSG:4978")])),
    _case("empty_system.las", las_bytes(STEPS, [(CRS, WKT, b"\0")])),
    _case(
        "feet_after_the_points_and_keys_in_metres.las",
        las_bytes(STEPS, [geo_keys((3072, 25832))], minor=4, extended=[wkt("EPSG:2222")]),
        POINTS * FOOT,
        warning=FEET,
    ),
    _case(
        "key_of_an_unknown_system.las",
        las_bytes(STEPS, [geo_keys((1024, 1), (3072, 60000))]),
        warning=NO_UNIT,
    ),
    _case(
        "key_of_a_unit_that_is_lost.las",
        las_bytes(STEPS, [geo_keys((3072, 32767), (3076, 32767), (3077, GEO_DOUBLES, 0))]),
        warning=NO_UNIT,
    ),
    _case(
        "keys_cut_short.las",
        las_bytes(STEPS, [(CRS, 34735, geo_keys((1024, 1), (3072, 2225))[2][:-3])]),
        warning=NO_UNIT,
    ),
]
