from __future__ import annotations

_MANY, _MANY_PER_BYTE = 1 << 24, 4
"""Maximum points of any stream, and additional points per byte: about 4 s of work for 1 MB."""


def most_points(size: int) -> int:
    """Return the maximum number of points or pixels in a stream of `size` bytes."""
    return _MANY + _MANY_PER_BYTE * size
