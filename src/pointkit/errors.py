"""Errors about input from a user: one line that names the file or key, and the fault."""

from __future__ import annotations

import sysconfig
import traceback
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from pathlib import Path

NARROWER = ": crop it, or take a coarser rate"
"""Advice for clouds that are too wide for a rate."""


class InputError(Exception):
    """Raised if a file, stream, name or value from the user cannot be used.

    The message is one line that names the file or key and says what is wrong. The command line and
    the workflow print it and exit with status 2.
    """


@contextmanager
def naming(what: object) -> Iterator[None]:
    """Prefix the message of an InputError that is raised inside the `with` block with `what`.

    If code in the block tries to end the process (`sys.exit`), this raises an InputError instead.
    """
    try:
        yield
    except InputError as error:
        if str(error).startswith(f"{what}: "):
            raise
        named = InputError(f"{what}: {error}")
        for note in getattr(error, "__notes__", ()):
            named.add_note(note)
        raise named from error
    except SystemExit as error:
        raise InputError(f"{what}: {error_text(error)}") from error


@contextmanager
def noting(note: str) -> Iterator[None]:
    """Add a note, such as the rate being coded, to an exception raised in the `with` block."""
    try:
        yield
    except BaseException as error:
        error.add_note(note)
        raise


def error_text(error: BaseException) -> str:
    """Return one line with an exception's notes, class, message, and the line that raised it.

    If possible, this is a line of neither Python's own code nor an installed package.
    """
    notes = ", ".join(getattr(error, "__notes__", ()))
    message = " ".join(str(error).split())
    if isinstance(error, SystemExit):
        message = f"exit status {message or 0}"
    words = ": ".join(filter(None, [notes, type(error).__name__, message]))
    frames = traceback.extract_tb(error.__traceback__)
    if not frames:
        return words
    near = [frame for frame in frames if not _is_installed(frame.filename)] or frames
    return f"{words} ({Path(near[-1].filename).name}:{near[-1].lineno})"


def _is_installed(file: str) -> bool:
    packages = {"site-packages", "dist-packages"} & {*Path(file).parts}
    return bool(packages) or file.startswith((sysconfig.get_path("stdlib"), "<frozen"))


def among(name: str, names: Iterable[str]) -> str:
    """Return the end of an error message about an unknown name.

    Parameters
    ----------
    name
        The unknown name.
    names
        The valid names, which the text lists. It also suggests a similar one, if there is any.
    """
    names = list(names)
    return f" (known: {', '.join(names)}){closest(name, names)}"


def closest(name: str, names: list[str]) -> str:
    """Return ``; did you mean 'x'?`` if one of `names` is similar to `name`, else ``""``."""
    near = get_close_matches(name, names, n=1)
    return f"; did you mean '{near[0]}'?" if near else ""


def counted(count: int, noun: str) -> str:
    """Return a number and a noun as text, such as ``1 frame`` or ``2 frames``."""
    return f"{count:,} {noun}" if count == 1 else f"{count:,} {noun}s"
