"""The one exception a user can cause, printed as one line with exit status 2."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

NARROWER = ": crop it, or take a coarser rate"
"""What errors advise where a cloud is too wide for a rate."""


class InputError(Exception):
    """Something the user gave (file, stream, name, value) cannot be used.

    The message is one line that names the file or key and the fault. It is raised where the
    fault is known and printed once, at the edge (command line or workflow), with exit status 2.
    """


@contextmanager
def naming(what: object) -> Iterator[None]:
    """Let the message of an `InputError` from the block begin with what it is about, once."""
    try:
        yield
    except InputError as error:
        if str(error).startswith(f"{what}: "):
            raise
        raise InputError(f"{what}: {error}") from error
