"""Reading and writing of syntax elements bit by bit.

The same function reads a structure with a `BitReader` and writes it with a `BitWriter`. Methods are
named after the standard's descriptors u(n), ue(v) and se(v).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

from pointkit.errors import InputError

_LONGEST_NUMBER = 32
_TRUNCATED = "G-PCC stream: a parameter set or header is truncated"


class SyntaxElements(ABC):
    """Base class of readers and writers of syntax elements, which are attributes of a record.

    If `writing` is true, attributes are written as bits; otherwise they are read.
    """

    writing: bool

    @abstractmethod
    def bits(self, n: int, value: int) -> int:
        """Read or write a number of `n` bits, highest bit first, and return the number."""

    @abstractmethod
    def align(self) -> None: ...

    def u(self, record: Any, name: str, n: int) -> None:
        setattr(record, name, self.bits(n, int(getattr(record, name))))

    def flag(self, record: Any, *names: str) -> None:
        for name in names:
            self.u(record, name, 1)

    def ue(self, record: Any, *names: str) -> None:
        for name in names:
            setattr(record, name, self.exp_golomb(int(getattr(record, name))))

    def se(self, record: Any, *names: str) -> None:
        for name in names:
            setattr(record, name, self.signed(int(getattr(record, name))))

    def u3(self, record: Any, name: str, n: int) -> None:
        setattr(record, name, tuple(self.bits(n, int(v)) for v in getattr(record, name)))

    def s3(self, record: Any, name: str, n: int) -> None:
        """Read or write three signed numbers, each as a magnitude followed by the sign."""
        values = []
        for value in getattr(record, name):
            magnitude = self.bits(n, abs(int(value)))
            values.append(-magnitude if self.bits(1, value < 0) else magnitude)
        setattr(record, name, tuple(values))

    def signed(self, value: int) -> int:
        """Read or write a signed number as an index in the sequence 0, 1, -1, 2, -2, ..."""
        code = self.exp_golomb(2 * abs(value) - (value > 0))
        return (code + 1) // 2 if code & 1 else -(code // 2)

    def exp_golomb(self, value: int) -> int:
        """Read or write an unsigned number in Exp-Golomb code of order 0, and return the number."""
        length = (value + 1).bit_length() - 1
        zeros = 0
        while not self.bits(1, zeros == length):
            zeros += 1
            if zeros > _LONGEST_NUMBER:
                raise InputError("G-PCC stream: a number in a parameter set or header is too long")
        return ((1 << zeros) | self.bits(zeros, (value + 1) & ((1 << length) - 1))) - 1


class BitWriter(SyntaxElements):
    writing = True

    def __init__(self) -> None:
        self._bits: list[int] = []

    def bits(self, n: int, value: int) -> int:
        if value >> n:
            raise ValueError(f"{value} does not fit in {n} bits")
        self._bits.extend(int(value) >> k & 1 for k in range(n - 1, -1, -1))
        return value

    def align(self) -> None:
        self._bits.extend([0] * (-len(self._bits) % 8))

    def bytes(self) -> bytes:
        self.align()
        return int("1" + "".join(map(str, self._bits)), 2).to_bytes(len(self._bits) // 8 + 1)[1:]


class BitReader(SyntaxElements):
    """Reader of syntax elements from bytes, which raises InputError past the end."""

    writing = False

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._place = 0

    def bits(self, n: int, value: int = 0) -> int:
        del value
        end = self._place + n
        if end > 8 * len(self._data):
            raise InputError(_TRUNCATED)
        first, last = self._place // 8, -(-end // 8)
        word = int.from_bytes(self._data[first:last])
        self._place = end
        return word >> (8 * last - end) & ((1 << n) - 1)

    def align(self) -> None:
        self._place = -(-self._place // 8) * 8

    def skip(self, n: int) -> None:
        self.bits(8 * n)

    @property
    def position(self) -> int:
        """Number of bytes of which at least one bit was read."""
        return -(-self._place // 8)
