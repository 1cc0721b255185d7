"""HTML elements whose text is always escaped: names in a report come from configurations."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape


class Markup(str):
    """Text that is HTML already and is not escaped again."""

    __slots__ = ()


def escaped(value: object) -> Markup:
    """`value` as HTML text; markup stays as it is."""
    return value if isinstance(value, Markup) else Markup(escape(str(value)))


def joined(parts: Iterable[object], separator: str = "") -> Markup:
    """The parts of an iterable, each escaped unless it is markup, one after the other."""
    return Markup(separator.join(escaped(part) for part in parts))


def tag(element: str, /, *content: object, **attributes: object) -> Markup:
    """The element ``<element ...>content</element>``.

    Attributes that are None or False are left out, True stands for a bare name; ``class_`` is
    ``class``, and ``data_column`` ``data-column``.
    """
    given = "".join(_attribute(key, value) for key, value in attributes.items())
    end = "" if element in _EMPTY else f"</{element}>"
    return Markup(f"<{element}{given}>{joined(content)}{end}")


_EMPTY = {"img", "input", "link", "meta"}


def _attribute(key: str, value: object) -> str:
    if value is None or value is False:
        return ""
    name = key.rstrip("_").replace("_", "-")
    return f" {name}" if value is True else f' {name}="{escape(str(value))}"'
