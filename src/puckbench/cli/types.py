from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pointkit.errors import InputError, error_text
from pointkit.files import unique_keys


def json_object(text: str) -> dict[str, Any]:
    """Parse an argument that must be a JSON object."""
    try:
        value = json.loads(text, object_pairs_hook=unique_keys)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"not JSON: {text} ({error})") from error
    if not isinstance(value, dict):
        raise argparse.ArgumentTypeError(f"not a JSON object: {text}")
    return value


def files_by_name(values: dict[str, Any], option: str) -> dict[str, Path]:
    """Convert a JSON object of file names to paths.

    Parameters
    ----------
    values
        Names of files, by any names.
    option
        Option that contained the object, for the error message.

    Raises
    ------
    InputError
        A value is not a string.
    """
    for name, value in values.items():
        if not isinstance(value, str):
            raise InputError(f"{option}: {name}: '{value}' is not a file name")
    return {name: Path(value) for name, value in values.items()}


@contextmanager
def made_of_tables(what: str) -> Iterator[None]:
    """Raise InputError in place of errors that unsuitable tables cause in the `with` block.

    Parameters
    ----------
    what
        What the block makes from tables that the user gave, such as "figure chamfer_rd"; the error
        message begins with it.
    """
    try:
        yield
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        raise InputError(f"{what}: the tables do not fit: {error_text(error)}") from error


def number_or_nan(text: str) -> float:
    """Return the number that a text contains, or NaN if it contains none."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def positive(text: str) -> float:
    """Parse an argument that must be a number above 0."""
    number = number_or_nan(text)
    if not 0 < number < math.inf:
        raise argparse.ArgumentTypeError(f"'{text}' is not a number above 0")
    return number


def integer(low: int) -> Any:
    """Return a parser for an argument that must be an integer of at least `low`."""

    def convert(text: str) -> int:
        if not text.lstrip("-").isdigit() or int(text) < low:
            raise argparse.ArgumentTypeError(f"'{text}' is not an integer of at least {low}")
        return int(text)

    return convert


def turns(text: str | None) -> tuple[int, int] | None:
    """Parse the option ``--turns``, such as ``7`` or ``7-9``.

    A turn is one revolution of the sensor.

    Returns
    -------
    tuple or None
        Numbers of the first and the last turn, or None if the option was not given.
    """
    if text is None:
        return None
    first, _, last = text.partition("-")
    if not first.isdecimal() or not (last or first).isdecimal():
        raise InputError(f"--turns: must be a number, or two joined by a hyphen, not '{text}'")
    numbers = int(first), int(last or first)
    if numbers[1] < numbers[0]:
        raise InputError(f"--turns: the last turn is before the first in '{text}'")
    return numbers


def refuse(options: argparse.Namespace, defaults: Mapping[str, Any], why: str) -> None:
    """Raise InputError if the user set an option that has no effect in this case.

    Parameters
    ----------
    options
        The parsed options.
    defaults
        Defaults of the options that have no effect, by name.
    why
        Reason, which follows the option's name in the error message.
    """
    for name, default in defaults.items():
        if getattr(options, name) != default:
            raise InputError(f"--{name.replace('_', '-')}: {why}")


def selected(options: argparse.Namespace, *names: str) -> dict[str, Any]:
    """Return the values of the named options, by name."""
    return {name: getattr(options, name) for name in names}


def note(line: str) -> None:
    """Print a remark to standard error."""
    print(f"puckbench: {line}", file=sys.stderr)  # noqa: T201
