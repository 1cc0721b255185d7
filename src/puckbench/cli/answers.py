"""A command's answer as text for a terminal: one line for each value, tables of what is alike."""

from __future__ import annotations

import shutil
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

_WIDEST, _NARROWEST = 120, 40
_INDENT = "  "


def text_of(answer: Mapping[str, Any]) -> str:
    """The answer in lines: names and values, and under the name of a table its rows."""
    plain = {name: value for name, value in answer.items() if not _rows(value)}
    width = max(map(len, plain), default=0)
    lines = []
    for name, value in answer.items():
        if rows := _rows(value):
            lines += [name, *(_INDENT + line for line in aligned(rows))]
        else:
            lines.append(f"{name:{width}}  {_text(value)}")
    return "\n".join(lines)


def aligned(rows: Sequence[Sequence[str]]) -> Iterator[str]:
    """Rows with columns of equal width; the last one is wrapped to the terminal."""
    widths = [max(map(len, column)) for column in list(zip(*rows, strict=True))[:-1]]
    lead = sum(widths) + len(_INDENT) * len(widths)
    terminal = min(shutil.get_terminal_size((_WIDEST, 0)).columns, _WIDEST) - len(_INDENT)
    for row in rows:
        first = "".join(
            f"{cell:{width}}{_INDENT}" for cell, width in zip(row, widths, strict=False)
        )
        wrapped = textwrap.wrap(row[-1], max(terminal - lead, _NARROWEST)) or [""]
        yield (first + wrapped[0]).rstrip()
        yield from (" " * lead + line for line in wrapped[1:])


def _rows(value: Any) -> list[list[str]]:
    """A table with its heading of several mappings, listed or by name; else nothing."""
    if isinstance(value, Mapping) and value and all(isinstance(v, Mapping) for v in value.values()):
        value = [{"": name, **row} for name, row in value.items()]
    if not isinstance(value, list) or not value or not all(isinstance(v, Mapping) for v in value):
        return []
    names = list(dict.fromkeys(name for row in value for name in row))
    return [names, *([_text(row.get(name, "")) for name in names] for row in value)]


def _text(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {_text(one)}" for name, one in value.items())
    if isinstance(value, (list, tuple)):
        return ", ".join(map(_text, value)) or "none"
    return "-" if value is None else str(value)
