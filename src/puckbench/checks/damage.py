"""Check with damaged streams, which must end in an InputError or in points."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from pointkit.errors import InputError, error_text
from puckbench.checks.registry import CHECKS, Fault
from puckbench.checks.subject import Subject
from puckbench.codecs.external import ExternalCodec

_MORE_BYTES = 2 << 30
"""Memory that decoding a damaged stream may take, bytes."""
_MOST_SECONDS = 5.0
_POINTS = 384
_CUTS, _FLIPS = 16, 60
_FEWER = 10
"""Factor by which fewer streams are decoded by programs, which take longer to start."""
_RAISE = (
    "raise InputError for damage: within decode, `with reading('stream of mine', *PARSER_FAULTS):` "
    "of pointkit.damage turns other exceptions into it"
)
_BOUND = "compare announced sizes with the length of the stream before you use them"


@CHECKS.register("damage", rank=130, advice=_BOUND, seconds=60.0)
def damage(subject: Subject) -> str:
    """Decode streams that are cut, or in which some bytes are changed."""
    stream = subject.encode(subject.surface(_POINTS), subject.rates[0])
    fewer = _FEWER if isinstance(subject.codec, ExternalCodec) else 1
    refused = decoded = 0
    with _limited_memory():
        for name, damaged in _damaged(stream, fewer):
            start = time.perf_counter()
            try:
                subject.decode(damaged)
                decoded += 1
            except InputError:
                refused += 1
            except MemoryError as error:
                raise Fault(f"{name}: takes more than 2 GiB: {_BOUND}") from error
            except Exception as error:
                raise Fault(f"{name}: {error_text(error)}: {_RAISE}") from error
            if (seconds := time.perf_counter() - start) > _MOST_SECONDS * fewer:
                raise Fault(f"{name}: takes {seconds:.0f} s: {_BOUND}")
    return f"{refused} damaged streams refused, {decoded} decoded"


def _damaged(stream: bytes, fewer: int) -> Iterator[tuple[str, bytes]]:
    """Yield damaged streams, each with what was done to it."""
    random, size = np.random.default_rng(17), len(stream)
    yield "the empty stream", b""
    yield "a stream of another codec", bytes(range(65, 91))
    for length in np.unique(np.linspace(1, size - 1, _CUTS // fewer + 1).astype(int)).tolist():
        yield f"a stream cut after {length} of {size} bytes", stream[:length]
    for _ in range(_FLIPS // fewer):
        damaged = bytearray(stream)
        # Headers are at the beginning: a third of the changes is there.
        end = min(size, 24) if random.random() < 1 / 3 else size
        places = random.integers(0, end, random.integers(1, 4))
        for place in places:
            damaged[place] = random.integers(0, 256)
        yield f"a stream with other bytes at {', '.join(map(str, places))}", bytes(damaged)


@contextmanager
def _limited_memory() -> Iterator[None]:
    """Limit the address space of this process to what it has and `_MORE_BYTES`; Linux only."""
    if sys.platform != "linux":
        yield
        return
    import resource

    pages = int(Path("/proc/self/statm").read_text().split()[0])
    before, hard = resource.getrlimit(resource.RLIMIT_AS)
    limit = pages * resource.getpagesize() + _MORE_BYTES
    if hard != resource.RLIM_INFINITY:
        limit = min(limit, hard)
    resource.setrlimit(resource.RLIMIT_AS, (limit, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (before, hard))
