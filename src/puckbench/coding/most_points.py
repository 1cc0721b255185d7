"""How many points or pixels a stream may hold, by its length alone."""

from __future__ import annotations

_MANY, _MANY_PER_BYTE = 1 << 24, 4
"""Of any stream, and for each byte of it beside them: some 4 s of work for a stream of 1 MB."""


def most_points(size: int) -> int:
    """Points or pixels in a stream of `size` bytes, at most, whatever they are coded by."""
    return _MANY + _MANY_PER_BYTE * size
