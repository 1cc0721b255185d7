"""Bytes between packets and clouds come back, in no more bytes than `xz` takes for images."""

from __future__ import annotations

import lzma

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pointkit.coding.byte_io import Reader
from puck.gaps import decode_gaps, encode_gaps, store_gaps


def images(count: int, noise: float, shape: tuple[int, int] = (120, 160)) -> list[bytes]:
    """Smooth grey images with noise, each with a header; the scene moves by two pixels."""
    random, found = np.random.default_rng(0), []
    for number in range(count):
        y, x = np.indices(shape) + 2 * number
        grey = 128 + 60 * np.sin(x / 17) + 40 * np.cos(y / 23) + random.normal(0, noise, shape)
        head = b"header of image" + number.to_bytes(4, "little")
        found.append(head + grey.clip(0, 255).astype(np.uint8).tobytes())
    return found


def xz(data: bytes) -> int:
    return len(lzma.compress(data, preset=9 | lzma.PRESET_EXTREME))


def decoded(body: bytes, count: int) -> list[bytes]:
    return decode_gaps(Reader(body), count, lambda size: None)


@pytest.mark.parametrize("count", [2, 3, 6])
@pytest.mark.parametrize("noise", [0, 1, 10])
def test_images_between_clouds_take_no_more_than_by_xz(count: int, noise: float) -> None:
    gaps = images(count, noise)
    body = encode_gaps(gaps)
    assert decoded(body, count) == gaps
    assert len(body) <= xz(b"".join(gaps))


def test_long_gaps_that_count_are_differences() -> None:
    rows = np.arange(2000, dtype="<u4") * 977 + 123_457 * np.arange(12, dtype="<u4")[:, None]
    gaps = [row.tobytes() for row in rows]
    body = encode_gaps(gaps)
    assert decoded(body, 12) == gaps
    assert len(body) < 0.2 * xz(b"".join(gaps))


@settings(max_examples=40, deadline=None)
@given(
    pieces=st.lists(st.sampled_from([b"", b"a", b"bc" * 3, bytes(1500), bytes(range(256)) * 8])),
    noise=st.binary(min_size=2048, max_size=2048), more=st.integers(0, 3), stored=st.booleans(),
)  # fmt: skip
def test_any_gaps_come_back(pieces: list[bytes], noise: bytes, more: int, stored: bool) -> None:
    gaps = [*pieces, *[noise, noise[::-1]] * more, b"end"]
    body = (store_gaps if stored else encode_gaps)(gaps)
    assert decoded(body, len(gaps)) == gaps
