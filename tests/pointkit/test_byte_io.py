"""Numbers and bytes of a stream."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointkit.coding.byte_io import Reader, base_128, signed_128
from pointkit.errors import InputError


@given(st.lists(st.integers(0, 2**35 - 1)), st.lists(st.integers(-(2**33), 2**33)))
def test_numbers_come_back(plain: list[int], signed: list[int]) -> None:
    body = b"".join([*map(base_128, plain), *map(signed_128, signed)])
    reader = Reader(body)
    assert [reader.number() for _ in plain] == plain
    assert [reader.signed() for _ in signed] == signed
    assert reader.at == len(body)


def test_small_numbers_take_a_byte() -> None:
    assert [len(base_128(number)) for number in (0, 127, 128, 2**14 - 1, 2**14)] == [1, 1, 2, 2, 3]
    assert [len(signed_128(number)) for number in (-64, 63, 64)] == [1, 1, 2]


@pytest.mark.parametrize("body", [b"", b"\x80", b"\xff" * 6])
def test_numbers_without_an_end_are_refused(body: bytes) -> None:
    with pytest.raises(InputError, match=r"truncated|damaged"):
        Reader(body).number()


def test_bytes_beyond_the_end_are_refused() -> None:
    reader = Reader(b"abc")
    assert reader.take(2) == b"ab"
    with pytest.raises(InputError, match="truncated"):
        reader.take(2)
