"""Threads that share the rows of a layer, each with working memory that it keeps.

A product of matrices may be summed in another order when another number of threads computes it.
Here each chunk of rows is one thread's from beginning to end, so that the number of threads changes
who computes a chunk and never its result. Memory kept from layer to layer is memory that the
system need not clear and map anew each time, which would cost as much as the arithmetic.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import TypeVar

import torch
from torch import Tensor

T = TypeVar("T")


class Scratch:
    """Flat float32 memory by name, as large as the largest request so far."""

    def __init__(self) -> None:
        self._held: dict[str, Tensor] = {}

    def take(self, name: str, size: int) -> Tensor:
        """`size` floats, whatever they hold; the next request of the name gets the same memory."""
        held = self._held.get(name)
        if held is None or len(held) < size:
            held = self._held[name] = torch.empty(size, dtype=torch.float32)
        return held[:size]


class Crew:
    """`threads` workers, each with its own scratch, and one scratch for what all work on."""

    def __init__(self, threads: int, pool: ThreadPoolExecutor | None = None) -> None:
        self.threads = threads
        self.shared = Scratch()
        self._pool = pool
        self._own = threading.local()

    def over(self, rows: int, size: int, work: Callable[[slice, Scratch], T]) -> list[T]:
        """Results of `work` on each chunk of `size` rows of 0 to `rows`, in order."""
        chunks = [slice(first, min(rows, first + size)) for first in range(0, rows, size)]

        def one(chunk: slice) -> T:
            if not hasattr(self._own, "scratch"):
                self._own.scratch = Scratch()
            with torch.no_grad():  # a thread of its own begins with gradients on
                return work(chunk, self._own.scratch)

        if self._pool is None or len(chunks) == 1:
            return [one(chunk) for chunk in chunks]
        return list(self._pool.map(one, chunks))

    def begin(self, work: Callable[[], T]) -> Callable[[], T]:
        """Begin a work; what is returned waits for its result."""
        if self._pool is None:
            result = work()
            return lambda: result
        return self._pool.submit(work).result


@contextmanager
def crew(threads: int | None = None) -> Iterator[Crew]:
    """A crew of `threads` (PyTorch's number by default); while it works PyTorch itself uses one."""
    before = torch.get_num_threads()
    threads = threads or before
    torch.set_num_threads(1)
    try:
        # a thread's first product would else be computed by as many threads as the machine has
        with ThreadPoolExecutor(threads, "sparse", torch.set_num_threads, (1,)) as pool:
            yield Crew(threads, pool if threads > 1 else None)
    finally:
        torch.set_num_threads(before)
