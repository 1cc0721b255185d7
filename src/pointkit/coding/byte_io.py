"""Whole numbers and bytes in streams that are read from the first byte to the last."""

from __future__ import annotations

from pointkit.errors import InputError

_LONGEST_NUMBER = 5


def base_128(number: int) -> bytes:
    """Return a non-negative number as unsigned LEB128: seven bits per byte, the lowest first."""
    groups = [number & 127]
    while number := number >> 7:
        groups.append(number & 127)
    return bytes([*(group | 128 for group in groups[:-1]), groups[-1]])


def signed_128(number: int) -> bytes:
    """Return an integer n as LEB128 of 2 n, or of -2 n - 1 if n is negative (zigzag)."""
    return base_128(2 * number if number >= 0 else -2 * number - 1)


def stream_bytes(stream: object) -> bytes:
    """Return a stream as bytes; raise InputError if it is not a bytes-like object."""
    if not isinstance(stream, bytes | bytearray | memoryview):
        raise InputError(f"a stream is bytes, not {type(stream).__name__}")
    return bytes(stream)


class Reader:
    """Reads numbers and bytes from a stream, one after the other.

    Its methods raise InputError if the stream ends too early.

    Parameters
    ----------
    body
        The stream, as bytes.
    """

    def __init__(self, body: bytes) -> None:
        self.body, self.at = body, 0

    def take(self, size: int) -> bytes:
        """Return the next `size` bytes; raise InputError if fewer remain."""
        self.at += size
        if self.at > len(self.body):
            raise InputError("the stream is truncated")
        return self.body[self.at - size : self.at]

    def rest(self) -> bytes:
        """Return all bytes that have not been read yet."""
        return self.take(len(self.body) - self.at)

    def number(self, longest: int = _LONGEST_NUMBER) -> int:
        """Read and return a non-negative number that `base_128` wrote.

        Parameters
        ----------
        longest
            Greatest number of bytes that the number may have, by default five.

        Raises
        ------
        InputError
            The number has more bytes, or the stream ends.
        """
        number = 0
        for k in range(longest):
            byte = self.take(1)[0]
            number |= (byte & 127) << 7 * k
            if byte < 128:
                return number
        raise InputError("the stream is damaged (a number)")

    def signed(self, longest: int = _LONGEST_NUMBER) -> int:
        """Read and return an integer that `signed_128` wrote, of at most `longest` bytes."""
        zigzag = self.number(longest)
        return -(zigzag + 1 >> 1) if zigzag & 1 else zigzag >> 1
