from __future__ import annotations

_MANY, _MANY_PER_BYTE = 1 << 24, 4
"""Points allowed in any stream, and further points per byte; 1 MB takes about 4 s at most."""


def most_points(size: int) -> int:
    """Return the largest number of points or pixels that a stream of `size` bytes may contain.

    Decoders refuse more, so that a damaged stream cannot take much memory or time.
    """
    return _MANY + _MANY_PER_BYTE * size
