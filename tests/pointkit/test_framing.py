"""The frame of a stream refuses every stream but its own, whole ones."""

import pytest

from pointkit.coding.framing import Framing
from pointkit.errors import InputError

FRAMING = Framing(b"ABCD", 3, "grid", header=2)
STREAM = FRAMING.framed(b"the body", b"\x01\x02")


def test_header_and_body_come_back() -> None:
    assert FRAMING.unframed(STREAM) == (b"\x01\x02", b"the body")
    assert STREAM.startswith(b"ABCD\x03\x01\x02")
    assert len(STREAM) == 4 + 1 + 2 + 4 + len(b"the body")


@pytest.mark.parametrize("place", [0, 4, 7, 10, 11, 18])
def test_a_changed_byte_is_noticed(place: int) -> None:
    damaged = bytearray(STREAM)
    damaged[place] ^= 1
    with pytest.raises(InputError, match=r"not a grid stream|damaged"):
        FRAMING.unframed(bytes(damaged))


@pytest.mark.parametrize("size", range(len(STREAM)))
def test_a_part_is_refused(size: int) -> None:
    with pytest.raises(InputError, match="truncated"):
        FRAMING.unframed(STREAM[:size])
