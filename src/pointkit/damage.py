"""Messages on damaged files, made of the exceptions of other packages' parsers."""

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
    """Convert exceptions of a parser, raised inside the `with` block, to InputError.

    Parameters
    ----------
    kind
        What is being read, for the message (such as "LAS file").
    *errors
        Exception classes to convert. Other exceptions pass unchanged.
    """
    try:
        yield
    except errors as error:
        raise InputError(f"not a readable {kind} ({one_line(error)})") from error


def one_line(error: Exception) -> str:
    """Return the message of an exception as one line of limited length.

    The message is cut after 120 characters. The name of the exception's class precedes it if the
    message is unclear without the name.
    """
    text = " ".join(str(error).split())[:_MAX_LENGTH]
    return f"{type(error).__name__}: {text}" if isinstance(error, _NEEDS_NAME) or not text else text
