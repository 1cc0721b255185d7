"""A pool of threads that share the rows of a layer, each with working memory that it keeps.

A matrix product may be summed in another order when another number of threads computes it. Here
each chunk of rows is computed by one thread from beginning to end, so that the number of threads
never changes a result. Memory is kept from layer to layer, since the system would otherwise clear
and map it anew each time, which costs as much as the arithmetic.
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
    """Flat float32 working memory by name, as large as the largest request so far."""

    def __init__(self) -> None:
        self._held: dict[str, Tensor] = {}

    def take(self, name: str, size: int) -> Tensor:
        """`size` uninitialised floats; the next request of the name gets the same memory."""
        held = self._held.get(name)
        if held is None or len(held) < size:
            held = self._held[name] = torch.empty(size, dtype=torch.float32)
        return held[:size]


class ThreadPool:
    """Threads, each with working memory of its own, and memory that they share.

    Parameters
    ----------
    threads
        How many there are.
    executor
        Runs them; without it the calling thread computes everything.
    """

    def __init__(self, threads: int, executor: ThreadPoolExecutor | None = None) -> None:
        self.threads = threads
        self.shared = Scratch()
        self._executor = executor
        self._own = threading.local()

    def map_chunks(self, rows: int, size: int, work: Callable[[slice, Scratch], T]) -> list[T]:
        """Results of `work` on each chunk of `size` rows out of `rows`, in order."""
        chunks = [slice(first, min(rows, first + size)) for first in range(0, rows, size)]

        def one(chunk: slice) -> T:
            if not hasattr(self._own, "scratch"):
                self._own.scratch = Scratch()
            with torch.no_grad():  # gradients are on when a thread starts
                return work(chunk, self._own.scratch)

        if self._executor is None or len(chunks) == 1:
            return [one(chunk) for chunk in chunks]
        return list(self._executor.map(one, chunks))

    def submit(self, work: Callable[[], T]) -> Callable[[], T]:
        """Begin to compute `work()`; the function that is returned waits for the result."""
        if self._executor is None:
            result = work()
            return lambda: result
        return self._executor.submit(work).result


@contextmanager
def thread_pool(threads: int | None = None) -> Iterator[ThreadPool]:
    """A pool of threads (PyTorch's number by default); meanwhile PyTorch itself uses one."""
    before = torch.get_num_threads()
    threads = threads or before
    torch.set_num_threads(1)
    try:
        # otherwise a thread's first product would use all cores of the machine
        with ThreadPoolExecutor(threads, "sparse", torch.set_num_threads, (1,)) as executor:
            yield ThreadPool(threads, executor if threads > 1 else None)
    finally:
        torch.set_num_threads(before)
