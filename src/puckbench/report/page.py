"""The page itself: its parts in order, with style, scripts and data inside."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from puckbench.report.assets import SCRIPTS, STYLE, asset, script_hash
from puckbench.report.markup import Markup, joined, tag
from puckbench.report.pictures import Picture

_CHAPTERS = {
    "5": "Chapter 5: the sensor and its errors",
    "6": "Chapter 6: what compression does",
    "": "Beyond the thesis",
}
_DISTORTION = (
    "Medians over the clouds of a data set at each rate; bars reach from the first to the third "
    "quartile, of the value upwards and of the bits per point across. A hollow marker on the lower "
    "edge is a zero, which a logarithmic axis cannot show. Point at a marker, or move between "
    "them with the arrow keys."
)
_CLOUDS = (
    "One view of three clouds: drag to turn, two fingers or (after a click) the wheel to come "
    "nearer, Shift and drag to move; or the arrow keys, + and −. On the right each decoded point "
    "has the colour of its distance to the nearest point of the original. Ceilings and what stands "
    "in front can be cut away."
)


@dataclass(frozen=True)
class Section:
    """A part of the page: its name in addresses, its heading, what stands in it."""

    name: str
    heading: str
    content: Markup


@dataclass(frozen=True)
class FigureShown:
    """A figure with its caption; `link` leads to the file to print from.

    chapter: that of the thesis, "5" or "6", or "".
    """

    name: str
    title: str
    chapter: str
    picture: Picture
    caption: Markup
    link: str


@dataclass(frozen=True)
class TableShown:
    """A table as HTML, with its caption."""

    name: str
    title: str
    table: Markup
    caption: Markup


def whole_page(title: str, sections: Iterable[Section], data: Mapping[str, Any]) -> str:
    """The HTML file. data: name -> what the scripts read, as JSON.

    A content security policy of its own keeps every browser from fetching anything.
    """
    parts = list(sections)
    scripts = [asset(name) for name in SCRIPTS]
    head = tag(
        "head",
        tag("meta", charset="utf-8"),
        tag("meta", http_equiv="Content-Security-Policy", content=_policy(scripts)),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("title", title),
        tag("style", Markup(asset(STYLE))),
    )
    body = tag(
        "body",
        _header(title, parts),
        tag("main", *(_section(part) for part in parts)),
        *(_data(name, value) for name, value in data.items()),
        *(tag("script", Markup(text)) for text in scripts),
    )
    return f"<!DOCTYPE html>\n{tag('html', head, body, lang='en')}\n"


def _policy(scripts: Iterable[str]) -> str:
    allowed = " ".join(f"'{script_hash(text)}'" for text in scripts)
    return f"default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src {allowed}"


def _header(title: str, parts: Iterable[Section]) -> Markup:
    links = (tag("a", part.heading, href=f"#{part.name}") for part in parts)
    return tag("header", tag("h1", title), tag("nav", *links, aria_label="Parts"))


def _section(part: Section) -> Markup:
    return tag("section", tag("h2", part.heading), part.content, id=part.name)


def _data(name: str, value: Any) -> Markup:
    """Data for the scripts; no character in it can end the element that holds it."""
    text = json.dumps(value, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    for character in "<>&":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return tag("script", Markup(text), type="application/json", id=f"data-{name}")


def curves_section() -> Section:
    """Where the script draws the interactive plot."""
    return Section("curves", "Rate and distortion", _for_script("plot", _DISTORTION))


def clouds_section() -> Section:
    """Where the script shows the example clouds."""
    return Section("clouds", "Example clouds", _for_script("viewer", _CLOUDS))


def _for_script(name: str, words: str) -> Markup:
    without = tag("noscript", tag("p", "This part needs JavaScript; nothing is fetched."))
    return joined([tag("p", words, class_="note"), without, tag("div", id=name)])


def tables_section(tables: Iterable[TableShown]) -> Section:
    """The tables, each folded away under its title."""
    shown = (
        tag(
            "details",
            tag("summary", table.title, " ", tag("code", table.name)),
            table.caption,
            table.table,
            id=f"table-{table.name}",
            class_="table",
        )
        for table in tables
    )
    return Section("tables", "Tables", joined(shown))


def figures_section(figures: Iterable[FigureShown]) -> Section:
    """The figures by chapter of the thesis, then those that it does not have."""
    known = list(figures)
    chapters = (
        joined([tag("h3", heading), tag("div", *map(_figure, chosen), class_="figures")])
        for chapter, heading in _CHAPTERS.items()
        if (chosen := [figure for figure in known if figure.chapter == chapter])
    )
    return Section("figures", "Figures", joined(chapters))


def _figure(figure: FigureShown) -> Markup:
    picture = tag(
        "img",
        src=figure.picture.uri,
        alt=figure.title,
        width=figure.picture.width,
        height=figure.picture.height,
    )
    link = tag("p", tag("a", "PDF", href=figure.link), ", if it lies beside this page.")
    caption = tag("figcaption", tag("h4", figure.title), figure.caption, link)
    return tag("figure", picture, caption, id=f"figure-{figure.name}")
