"""Messages of point_cloud_transport: streams of other programs' layouts, and damage."""

from __future__ import annotations

import gzip
import hashlib
import logging
import struct
import sys
import zlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from pureini import EncodingInfo, FieldType, PointcloudEncoder, PointField

from pointkit.coding.zstandard import compressed as zstd
from pointkit.errors import InputError
from puck.recordings.compressed_point_cloud2 import (
    decompressed_columns,
    parse_cloudini,
)
from tests.puck.test_point_cloud2 import Layout, message_of

POINTS = 40
ROWS = np.zeros(
    (1, POINTS),
    [
        *((axis, "<f4") for axis in "xyz"),
        ("rgb", "<u4"),
        ("ring", "<u2"),
        ("step", "<i1"),
        ("stamp", "<f8"),
    ],
)
for _axis in "xyz":
    ROWS[_axis] = np.random.default_rng(ord(_axis)).uniform(-9, 9, POINTS)
ROWS["rgb"], ROWS["ring"], ROWS["step"] = 0x102030, np.arange(POINTS), -np.arange(POINTS)
ROWS["stamp"] = 1.7e9 + np.arange(POINTS)
DRACO_KINDS = {"i1": 1, "u1": 2, "u2": 4, "f4": 9, "f8": 10}
POSITION, COLOUR, GENERIC = 0, 2, 4


@dataclass(frozen=True)
class Compressed(Layout):
    compressed_data: NDArray[np.uint8]
    format: str


def compressed(format_: str, stream: bytes, rows: NDArray[Any] = ROWS) -> Compressed:
    whole = message_of(rows)
    steps = (whole.point_step, whole.row_step)
    data = np.frombuffer(stream, np.uint8)
    return Compressed(*rows.shape, whole.fields, False, *steps, data, format_)


def draco_stream() -> bytes:
    """Draco's sequential stream: an attribute for each field; colours are four bytes."""
    columns = [(name, ROWS[name].reshape(-1)) for name in ROWS.dtype.names or ()]
    parts = [b"DRACO", bytes([2, 3, 0, 0]), struct.pack("<HIBB", 0, POINTS, 1, len(columns))]
    for number, (name, values) in enumerate(columns):
        kind = COLOUR if name == "rgb" else POSITION if name in "xyz" else GENERIC
        layout = (2, 4) if name == "rgb" else (DRACO_KINDS[values.dtype.str[1:]], 1)
        parts.append(bytes([kind, *layout, 0, number]))
    parts.append(bytes(len(columns)))  # values as they are
    parts += [values.tobytes() for _, values in columns]
    return b"".join(parts)


def cloudini_stream(rows: NDArray[Any] = ROWS) -> bytes:
    """Single precision in steps of a millimetre, as ROS writes it; all else as it is."""
    kinds = {"f4": 7, "u4": 6, "u2": 4, "i1": 1, "f8": 8}
    fields = [
        PointField(name, at, FieldType(kinds[kind.str[1:]]), 0.001 if kind == "<f4" else None)
        for name, (kind, at, *_) in (rows.dtype.fields or {}).items()
    ]
    info = EncodingInfo(fields, width=rows.size, point_step=rows.itemsize)
    return PointcloudEncoder(info).encode(rows.tobytes())


STREAMS = {
    "zlib": gzip.compress(ROWS.tobytes()),  # zlib_point_cloud_transport writes gzip's header
    "zstd": zstd(ROWS.tobytes()),
    "draco": draco_stream(),
    "cloudini": cloudini_stream(),
}


@pytest.mark.parametrize("format_", ["zlib", "zstd"])
def test_compressed_points_are_the_structured_array(format_: str) -> None:
    columns = decompressed_columns(compressed(format_, STREAMS[format_]))
    assert list(columns) == list(ROWS.dtype.names or ())
    for name, values in columns.items():
        assert values.tolist() == ROWS[name][0].tolist()


def test_a_header_of_zlib_itself_is_read_too() -> None:
    columns = decompressed_columns(compressed("zlib", zlib.compress(ROWS.tobytes())))
    assert columns["x"].tolist() == ROWS["x"][0].tolist()


def test_attributes_of_draco_are_the_fields_that_it_returns_exactly(
    caplog: pytest.LogCaptureFixture,
) -> None:
    with caplog.at_level(logging.WARNING):
        columns = decompressed_columns(compressed("draco", STREAMS["draco"]))
    assert list(columns) == ["x", "y", "z", "rgb", "ring", "step"]
    for name, values in columns.items():
        assert values.dtype == ROWS.dtype[name]
        assert values.tolist() == ROWS[name][0].tolist()
    assert "field 'stamp' is left out" in caplog.text


def test_points_of_cloudini_are_those_that_its_authors_library_stored() -> None:
    """The digest is that of the stream that the C++ library (commit d202e52) writes."""
    digest = "57e02f846f5517df80c58a88a7a5bbe33f0826677eb1b90dad1920eb25d4fb71"
    assert hashlib.sha256(STREAMS["cloudini"]).hexdigest() == digest
    columns = decompressed_columns(compressed("cloudini", STREAMS["cloudini"]))
    assert list(columns) == list(ROWS.dtype.names or ())
    for name, values in columns.items():
        assert values.dtype == ROWS.dtype[name]
        assert np.abs(values - ROWS[name][0]).max() <= 0.000501 * (name in "xyz")


def test_without_pureini_a_message_says_how_to_install_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, "pureini", None)
    (tmp_path / "cloud").write_bytes(STREAMS["cloudini"])
    with pytest.raises(InputError, match=r"Cloudini .*pip install pureini"):
        parse_cloudini(tmp_path / "cloud")


def test_no_points_are_no_points() -> None:
    for format_, stream in (("zstd", zstd(b"")), ("draco", b""), ("cloudini", b"")):
        columns = decompressed_columns(compressed(format_, stream, ROWS[:, :0]))
        assert columns["x"].tolist() == []


@pytest.mark.parametrize(
    ("message", "fault"),
    [
        (compressed("cloudini", b"x"), r"damaged \(Cloudini\), or newer"),
        (compressed("cloudini", STREAMS["cloudini"][:-9]), r"damaged \(Cloudini\)"),
        (compressed("cloudini", STREAMS["cloudini"], ROWS[:, :9]), "fields of the Cloudini stream"),
        (
            compressed("cloudini", STREAMS["cloudini"].replace(b"type: UINT16", b"type: INT16")),
            "fields of the Cloudini stream are not those of the message",
        ),
        (
            compressed("cloudini", STREAMS["cloudini"].replace(b"width: 40", b"width: 4000000000")),
            r"damaged \(Cloudini\)|takes more than 2 GiB",
        ),
        (
            compressed("a\nb" * 99, b"x"),
            r"compressed by 'a\\nba\\n[^ ]*, which is not read: zlib, zstd, draco, cloudini are",
        ),
        (compressed("zlib", STREAMS["zlib"][:-9]), r"damaged \(zlib\)"),
        (compressed("zlib", STREAMS["zstd"]), r"damaged \(zlib\)"),
        (compressed("zlib", gzip.compress(bytes(2000))), r"damaged \(zlib\)"),
        (compressed("zlib", gzip.compress(bytes(100))), "100 bytes of data are not 1 x 40"),
        (compressed("zstd", STREAMS["zstd"][:9]), "damaged|bytes of data are not"),
        (compressed("zstd", STREAMS["zlib"]), r"damaged \(Zstandard\)"),
        (compressed("zstd", zstd(bytes(2000))), r"damaged \(Zstandard\)"),
        (replace(compressed("zstd", b"x" * 9), width=1 << 30), "a cloud of .* in a stream of 9"),
        (compressed("draco", STREAMS["draco"][:-9]), r"damaged \(Draco\)"),
        (compressed("draco", b"DRACO"), r"damaged \(Draco\): not of 40 points"),
        (compressed("draco", STREAMS["draco"], ROWS[:, :9]), r"\(Draco\): not of 9 points"),
        (compressed("draco", STREAMS["draco"], ROWS[["x", "y"]]), "attributes of the Draco stream"),
    ],
)
def test_what_cannot_be_decompressed_is_one_line(message: Compressed, fault: str) -> None:
    with pytest.raises(InputError, match=fault) as refused:
        decompressed_columns(message)
    assert len(str(refused.value).splitlines()) == 1


@given(
    st.sampled_from(sorted(STREAMS)),
    st.lists(st.tuples(st.integers(0, 2000), st.integers(0, 255)), min_size=1, max_size=4),
    st.integers(1, 2000),
)
@settings(max_examples=60, deadline=None)
def test_a_damaged_stream_is_columns_of_the_declared_points_or_an_error(
    format_: str, changes: list[tuple[int, int]], length: int
) -> None:
    stream = bytearray(STREAMS[format_])
    for at, value in changes:
        stream[at % len(stream)] = value
    try:
        columns = decompressed_columns(compressed(format_, bytes(stream[:length])))
    except InputError:
        return
    assert all(len(values) == POINTS for values in columns.values())
