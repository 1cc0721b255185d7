"""What was run, in words: the data sets, the codecs, the machine, the whole configuration."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from puckbench.figures.binning import ordered_rates
from puckbench.figures.style import FigureStyle
from puckbench.report.markup import Markup, joined, tag
from puckbench.report.tables import text_of

if TYPE_CHECKING:
    import pandas as pd

_MAKES = {"sample": "sampled", "scan": "scanned", "cloud": "as captured"}
_KEYS = frozenset(["dataset", "cloud", "codec", "rate", "group"])
_MOST_VALUES = 5


def machine_html(machine: Mapping[str, str], metrics: pd.DataFrame | None) -> Markup:
    """The machine, and what the table of results says of where it was measured."""
    facts = dict(machine)
    if metrics is not None:
        facts |= {f"Table: {name}": ", ".join(found) for name, found in _said(metrics).items()}
    pairs = (part for name, text in facts.items() for part in (tag("dt", name), tag("dd", text)))
    return tag("dl", *pairs)


def _said(metrics: pd.DataFrame) -> dict[str, list[str]]:
    """Columns of text that hold for all codecs: the version that measured, the processor."""
    texts = [n for n in metrics.select_dtypes(exclude="number") if n not in _KEYS]
    found = {name: _distinct(metrics[name]) for name in texts if not _of_codec(str(name))}
    return {str(name): values[:_MOST_VALUES] for name, values in found.items() if values}


def _of_codec(column: str) -> bool:
    return column == "codec_version" or "weights" in column


def _distinct(values: pd.Series[Any]) -> list[str]:
    return list(dict.fromkeys(text_of(value) for value in values.dropna()))


def datasets_html(
    configuration: Mapping[str, Any], clouds: pd.DataFrame | None, style: FigureStyle
) -> Markup:
    """A row for each data set: how its clouds are made, how many and how large they are."""
    heads = ("Data set", "Scenes", "Clouds are", "Error model", "Clouds", "Points, median")
    loaders = {name: value["loader"] for name, value in configuration["scenes"].items()}
    rows = [
        (
            _titled(style.title(name), name),
            f"{value['scenes']} ({loaders[value['scenes']]})",
            _MAKES[value["make"]],
            value["errors"] if value["make"] == "scan" else "",
            *_sizes(clouds, name),
        )
        for name, value in configuration["datasets"].items()
    ]
    return _plain_table(heads, rows)


def _sizes(clouds: pd.DataFrame | None, dataset: str) -> tuple[str, str]:
    if clouds is None:
        return "", ""
    points = clouds.loc[clouds["dataset"] == dataset, "points"]
    return str(len(points)), f"{points.median():,.0f}" if len(points) else ""


def codecs_html(
    configuration: Mapping[str, Any], metrics: pd.DataFrame | None, style: FigureStyle
) -> Markup:
    """A row for each codec: its version, rates and options, and its weights where it has any."""
    heads = ("Codec", "Version and weights", "Rates", "Changed in the configuration")
    entries = configuration.get("codecs", {})
    names = list(entries) if metrics is None else metrics["codec"].unique()
    rows = [
        (
            _titled(style.look(name).title, name),
            _versions(metrics, name),
            _rates(metrics, name),
            _changes(entries.get(name)),
        )
        for name in style.ordered_codecs(names)
    ]
    return _plain_table(heads, rows)


def _titled(title: str, name: str) -> Markup:
    return joined([title, " ", tag("code", name)])


def _versions(metrics: pd.DataFrame | None, codec: str) -> str:
    if metrics is None:
        return ""
    rows = metrics[metrics["codec"] == codec]
    columns = [name for name in rows.select_dtypes(exclude="number") if _of_codec(str(name))]
    return "; ".join(text for name in columns for text in _distinct(rows[name])[:_MOST_VALUES])


def _rates(metrics: pd.DataFrame | None, codec: str) -> str:
    if metrics is None:
        return ""
    return ", ".join(ordered_rates(set(metrics.loc[metrics["codec"] == codec, "rate"])))


def _changes(entry: Mapping[str, Any] | None) -> Markup:
    return tag("code", json.dumps(entry, sort_keys=True)) if entry else Markup("")


def _plain_table(heads: Iterable[str], rows: Iterable[Iterable[object]]) -> Markup:
    head = tag("tr", *(tag("th", text, scope="col") for text in heads))
    body = (tag("tr", *(tag("td", cell) for cell in row)) for row in rows)
    table = tag("table", tag("thead", head), tag("tbody", joined(body)))
    return tag("div", table, class_="scroll", tabindex=0)


def configuration_html(configuration: Mapping[str, Any]) -> Markup:
    """All of the configuration, defaults filled in, folded away."""
    import yaml

    text = yaml.safe_dump(json.loads(json.dumps(configuration)), sort_keys=False, width=100)
    return tag("details", tag("summary", "The whole configuration"), tag("pre", text))
