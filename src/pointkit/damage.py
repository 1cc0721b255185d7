"""Errors of other packages' parsers, as one line about a damaged file."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager

from pointkit.errors import InputError

PARSER_FAULTS = (
    *(ArithmeticError, AssertionError, AttributeError, EOFError, LookupError, OSError),
    *(RuntimeError, TypeError, ValueError, struct.error),
)
"""Exceptions that other packages' parsers raise for damaged files."""
_MAX_LENGTH = 120
_NEEDS_NAME = (AssertionError, AttributeError, LookupError, TypeError)
"""Exceptions whose message needs the class name before it: that of a KeyError is only the key."""


@contextmanager
def reading(kind: str, *errors: type[Exception]) -> Iterator[None]:
    """Convert exceptions `errors`, raised in the `with` block, to InputError.

    `kind` names the file format in the message ("LAS file").
    """
    try:
        yield
    except errors as error:
        raise InputError(f"not a readable {kind} ({one_line(error)})") from error


def one_line(error: Exception) -> str:
    """Return an exception's message as one short line, with its class if the message needs it."""
    text = " ".join(str(error).split())[:_MAX_LENGTH]
    return f"{type(error).__name__}: {text}" if isinstance(error, _NEEDS_NAME) or not text else text
