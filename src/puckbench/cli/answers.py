from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from typing import Any

_WIDEST, _NARROWEST = 120, 40
_INDENT = "  "


def text_of(answer: Mapping[str, Any]) -> str:
    """Format the answer of a command as text for a terminal.

    Parameters
    ----------
    answer
        Values by name. A list of mappings, or a mapping of mappings, is a table.

    Returns
    -------
    str
        A line for each plain value; each table as lines below its name.
    """
    plain = {name: value for name, value in answer.items() if not _rows(value)}
    width = max(map(len, plain), default=0)
    lines = []
    for name, value in answer.items():
        if rows := _rows(value):
            lines += [name, *table(rows)]
        else:
            lines.append(f"{name:{width}}  {_text(value)}")
    return "\n".join(lines)


def table(rows: Sequence[Sequence[str]]) -> list[str]:
    """Format rows as lines of aligned columns.

    Parameters
    ----------
    rows
        Cells of the rows, of which the first is the heading. Text in the last column is wrapped.
    """
    from rich import box
    from rich.console import Console
    from rich.table import Table

    grid = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False)
    *heads, last = rows[0]
    for head in heads:
        grid.add_column(head, no_wrap=True)
    grid.add_column(last)
    for row in rows[1:]:
        grid.add_row(*row)
    columns = list(zip(*rows, strict=True))[:-1]
    least = sum(max(map(len, column)) + len(_INDENT) for column in columns) + _NARROWEST
    terminal = min(shutil.get_terminal_size((_WIDEST, 0)).columns, _WIDEST) - len(_INDENT)
    console = Console(width=max(terminal, least), color_system=None, markup=False, emoji=False)
    lines = console.render_lines(grid, pad=False)
    return [(_INDENT + "".join(part.text for part in line)).rstrip() for line in lines]


def _rows(value: Any) -> list[list[str]]:
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
        return ", ".join(f"{name} {_text(item)}" for name, item in value.items())
    if isinstance(value, (list, tuple)):
        return ", ".join(map(_text, value)) or "none"
    return "-" if value is None else str(value)
