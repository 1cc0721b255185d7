"""Data of point-cloud messages come back bit for bit, whatever they are."""

from __future__ import annotations

import lzma
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from pointkit.errors import InputError
from puck.cloud_data import CloudDecoder, CloudEncoder, CloudField, CloudLayout
from puck.clouds import coding
from puck.options import EFFORTS, CodingOptions, Effort

FIELD = st.builds(
    CloudField,
    st.sampled_from(["x", "y", "z", "ring", "time", "intensity", "", "ä"]),
    st.integers(0, 24),
    st.integers(0, 9),
    st.integers(0, 3),
)
LAYOUT = st.builds(
    CloudLayout, st.lists(FIELD, max_size=7).map(tuple), st.integers(0, 40), st.booleans()
)


def admit(_: int) -> None:
    """Admit any number of bytes."""


@settings(max_examples=40, deadline=None)
@given(
    layout=LAYOUT, messages=st.lists(st.binary(max_size=600), min_size=1, max_size=3),
    width=st.integers(0, 20), height=st.integers(0, 4), more=st.integers(0, 3),
    effort=st.sampled_from(EFFORTS),
)  # fmt: skip
def test_any_bytes_of_any_layout(
    layout: CloudLayout, messages: list[bytes], width: int, height: int, more: int, effort: Effort
) -> None:
    assert CloudLayout.unpacked(layout.packed()) == layout
    encoder = CloudEncoder(layout, CodingOptions(effort=effort))
    decoder = CloudDecoder(layout)
    row_step = width * layout.point_step + more
    for number, data in enumerate(messages):
        body = encoder.encode(data, width, height, row_step, is_key=number == 0)
        assert decoder.decode(body, admit) == data


POINT = np.dtype(
    {
        "names": ["x", "y", "z", "intensity", "ring", "time"],
        "formats": ["<f4", "<f4", "<f4", "<f4", "<u2", "<f4"],
        "offsets": [0, 4, 8, 16, 20, 24],
        "itemsize": 32,
    }
)
CODES = {"<f4": 7, "<u2": 4, "<u4": 6, "|u1": 2, "<f8": 8}
Points = NDArray[np.void]


def layout_of(kind: np.dtype[Any]) -> CloudLayout:
    fields = kind.fields or {}
    codes = [CloudField(name, at[1], CODES[at[0].str], 1) for name, at in fields.items()]
    return CloudLayout(tuple(codes), kind.itemsize, False)


def spinning(kind: np.dtype[Any], unit: float, steps: float, turn: int, lasers: int = 16) -> Points:
    """A turn of a sensor in a square room, in the layout of a driver, column by column.

    Ranges are multiples of `unit` unless it is 0, and azimuths of a step.
    """
    random = np.random.default_rng(turn)
    azimuths = 2 * np.pi / steps * (np.arange(int(steps))[:, None] + 0.3 * turn)
    elevations = np.radians(np.linspace(-15, 15, lasers))
    across = np.maximum(np.abs(np.sin(azimuths)), np.abs(np.cos(azimuths))) * np.cos(elevations)
    metres = (4 + turn / 50) / across + random.normal(0, 0.01, across.shape)
    if unit:
        metres = np.rint(metres / unit) * unit
    there = random.random(metres.shape) < 0.9
    points = np.zeros(int(there.sum()), kind)
    shape = np.broadcast_arrays(metres, azimuths, elevations, np.arange(lasers))
    r, azimuth, elevation, ring = (array[there] for array in shape)
    points["x"] = (r * np.cos(elevation) - 0.01) * np.cos(azimuth)
    points["y"] = (r * np.cos(elevation) - 0.01) * np.sin(azimuth)
    points["z"] = r * np.sin(elevation) + 0.02
    points["ring"] = ring
    names = kind.names or ()
    if "intensity" in names:
        points["intensity"] = random.integers(10, 30, len(points))
    if "time" in names:
        points["time"] = azimuth / (20 * np.pi) + ring * 2.304e-6
    if "timestamp" in names:
        points["timestamp"] = 1.7e9 + turn / 10 + azimuth / (20 * np.pi)
    return points


def through(kind: np.dtype[Any], clouds: list[Points], effort: Effort = "normal") -> list[bytes]:
    """Encode clouds, and return their bytes after decoding them."""
    layout = layout_of(kind)
    encoder, decoder = CloudEncoder(layout, CodingOptions(effort=effort)), CloudDecoder(layout)
    bodies = []
    for number, points in enumerate(clouds):
        rows, columns = points.shape if points.ndim == 2 else (1, len(points))
        row_step = columns * kind.itemsize
        data = points.tobytes()
        body = encoder.encode(data, columns, rows, row_step, is_key=number in (0, 2))
        assert decoder.decode(body, admit) == data
        bodies.append(body)
    return bodies


def xz_bytes(clouds: list[Points]) -> int:
    whole = b"".join(points.tobytes() for points in clouds)
    return len(lzma.compress(whole, preset=9 | lzma.PRESET_EXTREME))


@pytest.mark.parametrize("effort", EFFORTS)
@pytest.mark.parametrize(
    ("unit", "steps", "share"), [(0.002, 900, 0.25), (0, 900, 0.45), (0.004, 901.3, 0.25)]
)
def test_points_on_rays_take_less_than_half_of_xz(
    unit: float, steps: float, share: float, effort: Effort
) -> None:
    clouds = [spinning(POINT, unit, steps, turn) for turn in range(3)]
    assert sum(map(len, through(POINT, clouds, effort))) < share * xz_bytes(clouds)


def test_azimuths_without_steps() -> None:
    clouds = [spinning(POINT, 0, 900, turn) for turn in range(2)]
    random = np.random.default_rng(0)
    for points in clouds:
        off = random.normal(0, 0.001, len(points))
        points["x"], points["y"] = points["x"] - off * points["y"], points["y"] + off * points["x"]
    assert sum(map(len, through(POINT, clouds))) < 0.6 * xz_bytes(clouds)


def test_packed_points_with_absolute_times() -> None:
    formats = [(axis, "<f4") for axis in "xyz"]
    kind = np.dtype([*formats, ("intensity", "u1"), ("ring", "<u2"), ("timestamp", "<f8")])
    clouds = [spinning(kind, 0.004, 1800, turn) for turn in range(2)]
    assert sum(map(len, through(kind, clouds))) < 0.45 * xz_bytes(clouds)


def organised(rows: int, columns: int, missing: float) -> Points:
    """An Ouster's cloud: rows of a laser, turned by its azimuth, and ranges in millimetres."""
    kind = np.dtype(
        {
            "names": ["x", "y", "z", "t", "ring", "range"],
            "formats": ["<f4", "<f4", "<f4", "<u4", "u1", "<u4"],
            "offsets": [0, 4, 8, 20, 26, 32],
            "itemsize": 48,
        }
    )
    random = np.random.default_rng(1)
    turned = np.radians([3.1, -1.0, 1.0, -3.1])[np.arange(rows) % 4][:, None]
    elevations = np.radians(np.linspace(20, -20, rows))[:, None]
    encoder = 2 * np.pi * (1 - np.arange(columns) / columns)[None]
    walls = np.maximum(np.abs(np.cos(encoder)), np.abs(np.sin(encoder)))
    millimetres = np.rint(3000 / walls / np.cos(elevations) + random.normal(0, 9, (rows, columns)))
    millimetres[random.random((rows, columns)) < 0.1] = 0
    along, there = (millimetres / 1000 - 0.0277) * np.cos(elevations), millimetres > 0
    points = np.zeros((rows, columns), kind)
    points["x"] = along * np.cos(encoder - turned) + 0.0277 * np.cos(encoder)
    points["y"] = along * np.sin(encoder - turned) + 0.0277 * np.sin(encoder)
    points["z"] = (millimetres / 1000 - 0.0277) * np.sin(elevations)
    for axis in "xyz":
        points[axis][~there] = missing
    points["t"] = 97_656 * np.arange(columns)
    points["ring"] = np.arange(rows)[:, None]
    points["range"] = millimetres
    return points


@pytest.mark.parametrize("missing", [0.0, np.nan])
def test_organised_cloud_with_ranges(missing: float) -> None:
    clouds = [organised(32, 512, missing)] * 2
    first, again = through(clouds[0].dtype, clouds)
    assert len(first) < 0.35 * xz_bytes(clouds[:1])
    assert len(again) == 1  # the same message


def test_points_without_rings() -> None:
    kind = np.dtype([(name, "<f4") for name in ("x", "y", "z", "intensity")])
    points = np.sort(spinning(POINT, 0, 900, 0), order=["ring", "time"])
    cloud = np.zeros(len(points), kind)
    for name in kind.names or ():
        cloud[name] = np.round(points[name], 3)
    cloud["z"][::50] = -0.0
    assert len(through(kind, [cloud])[0]) < 0.9 * xz_bytes([cloud])


def test_noise_and_repetitions_take_no_more_than_lzma() -> None:
    random = np.random.default_rng(2)
    noise = np.frombuffer(random.bytes(32 * 3000), POINT)
    repeated = np.tile(noise[:7], 500)
    for cloud in (noise, repeated):
        assert len(through(POINT, [cloud])[0]) <= xz_bytes([cloud]) + 64


def test_few_of_many_columns_have_models(monkeypatch: pytest.MonkeyPatch) -> None:
    kind = np.dtype([("x", "<f4"), ("d", "<f4", (40,))])
    random, layout = np.random.default_rng(3), CloudLayout((CloudField("d", 4, 7, 40),), 164, False)
    cloud = np.zeros(200, kind)
    cloud["d"] = random.random((200, 40))
    data = cloud.tobytes() + b"end"

    def body() -> bytes:
        encoder = CloudEncoder(layout, CodingOptions())
        return encoder.encode(data, 200, 1, 200 * 164, is_key=True)

    plain = body()
    assert plain[0] & 15 == 1
    assert CloudDecoder(layout).decode(plain, admit) == data
    assert len(plain) < len(lzma.compress(data, preset=9 | lzma.PRESET_EXTREME))
    with monkeypatch.context() as patched:
        patched.setattr(coding, "_MOST_MODELLED", 40)
        patched.setattr(coding, "_MOST_MODELS", 3)  # models are dropped alike
        modelled = body()
        assert CloudDecoder(layout).decode(modelled, admit) == data
    with pytest.raises(InputError):
        CloudDecoder(layout).decode(modelled, admit)


@cache
def coded_turns() -> list[bytes]:
    return through(POINT, [spinning(POINT, 0.002, 900, turn) for turn in range(2)])


@settings(max_examples=40, deadline=None)
@given(number=st.integers(0, 1), place=st.floats(0, 1), more=st.integers(1, 255), cut=st.booleans())
def test_damage_is_noticed_or_decoded(number: int, place: float, more: int, cut: bool) -> None:
    bodies = coded_turns()
    damaged, at = bytearray(bodies[number]), int(place * (len(bodies[number]) - 1))
    damaged[at] = (damaged[at] + more) % 256
    stream = bytes(damaged[:at]) if cut else bytes(damaged)
    decoder = CloudDecoder(layout_of(POINT))
    if number:
        decoder.decode(bodies[0], admit)
    try:
        decoder.decode(stream, limited)
    except InputError:
        with pytest.raises(InputError, match="before"):
            decoder.decode(bodies[1], admit)


def limited(size: int) -> None:
    if size > 1 << 22:
        raise InputError("too many bytes")


def test_a_limit_is_observed_before_memory_is_taken() -> None:
    def refuse(size: int) -> None:
        raise InputError(f"{size} bytes")

    with pytest.raises(InputError, match="bytes"):
        CloudDecoder(layout_of(POINT)).decode(coded_turns()[0], refuse)


def test_a_cloud_needs_the_one_before() -> None:
    with pytest.raises(InputError, match="before"):
        CloudDecoder(layout_of(POINT)).decode(coded_turns()[1], admit)


def test_a_damaged_layout_is_refused() -> None:
    packed = layout_of(POINT).packed()
    for size in range(len(packed)):
        with pytest.raises(InputError):
            CloudLayout.unpacked(packed[:size])


@pytest.mark.parametrize(
    ("apart_m", "height_m"), [(0.008, 0.0), (1.0, 0.0), (0.5, 1e6), (0.5, -3e9)]
)
def test_rings_that_follow_from_ranges_and_lines_far_away(apart_m: float, height_m: float) -> None:
    """Neither can be a part of a stream: rings come before ranges, and rays are near."""
    azimuths = np.linspace(0, 2 * np.pi, 180, endpoint=False)[:, None]
    elevations, rings = np.radians(np.linspace(-15, 15, 16)), np.arange(16)
    ranges = 4 + apart_m * rings
    points = np.zeros((180, 16), POINT)
    points["x"] = ranges * np.cos(elevations) * np.cos(azimuths)
    points["y"] = ranges * np.cos(elevations) * np.sin(azimuths)
    points["z"] = ranges * np.sin(elevations) + height_m
    points["ring"] = rings
    (body,) = through(POINT, [points])
    assert len(body) < points.nbytes / 10
