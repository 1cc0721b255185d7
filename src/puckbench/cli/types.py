"""Argument types shared by the commands."""

from __future__ import annotations

import argparse
import json
import sys
from typing import Any

from puckbench.core.files import unique_keys


def json_object(text: str) -> dict[str, Any]:
    """A JSON object on the command line."""
    try:
        value = json.loads(text, object_pairs_hook=unique_keys)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"not JSON: {text} ({error})") from error
    if not isinstance(value, dict):
        raise argparse.ArgumentTypeError(f"not a JSON object: {text}")
    return value


def whole(low: int) -> Any:
    """A type for whole numbers of at least `low`."""

    def convert(text: str) -> int:
        if not text.lstrip("-").isdigit() or int(text) < low:
            raise argparse.ArgumentTypeError(f"'{text}' is not a whole number of at least {low}")
        return int(text)

    return convert


def chosen(options: argparse.Namespace, *names: str) -> dict[str, Any]:
    """Some of a command's options by name, as fields of the job that it runs."""
    return {name: getattr(options, name) for name in names}


def tell(line: str) -> None:
    """Say on standard error what is no part of the answer."""
    print(f"puckbench: {line}", file=sys.stderr)  # noqa: T201
