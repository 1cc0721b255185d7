"""Parts of a stream: variable-length integers (base 128, as LEB128) and runs of bytes."""

from __future__ import annotations

from puckbench.core.errors import InputError

_LONGEST_NUMBER = 5


def base_128(number: int) -> bytes:
    """Code a number of at least 0: seven bits a byte, lowest first; the top bit: more follow."""
    groups = [number & 127]
    while number := number >> 7:
        groups.append(number & 127)
    return bytes([*(group | 128 for group in groups[:-1]), groups[-1]])


def signed_128(number: int) -> bytes:
    """Code any whole number as `base_128` (zigzag): 2 n, or -2 n - 1 below zero."""
    return base_128(2 * number if number >= 0 else -2 * number - 1)


class Reader:
    """Reads the parts of a stream one after the other."""

    def __init__(self, body: bytes) -> None:
        self.body, self.at = body, 0

    def take(self, size: int) -> bytes:
        """The next `size` bytes; InputError when there are fewer."""
        self.at += size
        if self.at > len(self.body):
            raise InputError("the stream is truncated")
        return self.body[self.at - size : self.at]

    def rest(self) -> bytes:
        """All bytes that are left."""
        return self.take(len(self.body) - self.at)

    def number(self, longest: int = _LONGEST_NUMBER) -> int:
        """A number of `base_128`; InputError when it has more than `longest` bytes."""
        number = 0
        for k in range(longest):
            byte = self.take(1)[0]
            number |= (byte & 127) << 7 * k
            if byte < 128:
                return number
        raise InputError("the stream is damaged (a number)")

    def signed(self, longest: int = _LONGEST_NUMBER) -> int:
        """A number of `signed_128`."""
        twice = self.number(longest)
        return -(twice + 1 >> 1) if twice & 1 else twice >> 1
