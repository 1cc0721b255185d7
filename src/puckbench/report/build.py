"""From a run's files to the page's text: what both the command line and the workflow call."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from puckbench.core.files import read_bytes
from puckbench.figures.registry import figure_entry
from puckbench.figures.style import FigureStyle
from puckbench.io.clouds import read_cloud
from puckbench.io.tables import read_table
from puckbench.report import page
from puckbench.report.captions import caption_html
from puckbench.report.clouds import example_payload, points_each, shown_decoded, shown_original
from puckbench.report.contents import Contents, Example
from puckbench.report.curves import codec_look, curves
from puckbench.report.facts import codecs_html, configuration_html, datasets_html, machine_html
from puckbench.report.markup import Markup, joined, tag
from puckbench.report.pictures import embedded
from puckbench.report.tables import table_html

if TYPE_CHECKING:
    import pandas as pd

TITLES = {
    "claims": "The thesis's claims, one by one",
    "thesis_medians": "The thesis's medians beside this run's",
    "summary": "Medians per data set, codec and rate",
    "bd_rate": "Bjontegaard deltas per data set",
    "bd_rate_clouds": "Bjontegaard deltas per cloud",
    "gpcc_scales": "G-PCC by scale",
    "clouds": "The clouds",
    "machines": "Machines and versions",
    "residual_statistics": "Statistics of plane residuals",
    "residual_incidence": "Plane residuals by incidence",
    "incidence_effect": "The effect of incidence",
    "thesis_numbers": "The thesis's numbers beside this run's",
    "model_distances": "How far error models are from real walls",
    "table_4_1": "The VLP-16 (thesis table 4.1)",
    "table_4_2": "Lasers of the VLP-16 (thesis table 4.2)",
    "table_5_1": "Parameters of the virtual VLP-16 (thesis table 5.1)",
}
"""Tables in the order of the page; others follow under their own name."""
_CAPTION_FILES = {"summary": "summary_table", "clouds": "clouds_table"}
_COLOUR_STOPS = 64
_COLOUR_MAPS = {"height": ("viridis", 0.2), "error": ("inferno", 0.25)}
"""Maps of the viewer, and where they begin: their dark ends do not show on its background."""


def build_page(contents: Contents, machine: Mapping[str, str], folder: Path) -> str:
    """The page as text; the same files and the same machine give the same text.

    folder: where the page will lie, which its links start from. InputError names a file that is
    missing or cannot be read.
    """
    style = FigureStyle.from_config(*contents.style)
    metrics = None if contents.metrics is None else read_table(Path(contents.metrics))
    tables = {name: read_table(Path(contents.tables[name])) for name in _ordered(contents.tables)}
    data: dict[str, Any] = {}
    sections = [_run(contents, metrics, tables.get("clouds"), machine, style)]
    if metrics is not None:
        data["curves"] = curves(metrics, style)
        sections.append(page.curves_section())
    if contents.examples:
        data["clouds"] = viewer_payload(contents, metrics, style)
        sections.append(page.clouds_section())
    if tables:
        sections.append(page.tables_section(_tables(contents, tables, folder)))
    if contents.figures:
        sections.append(page.figures_section(_figures(contents, folder)))
    return page.whole_page(contents.title, sections, data)


def _ordered(tables: Mapping[str, str]) -> list[str]:
    known = [name for name in TITLES if name in tables]
    return known + [name for name in tables if name not in TITLES]


def _run(
    contents: Contents,
    metrics: pd.DataFrame | None,
    clouds: pd.DataFrame | None,
    machine: Mapping[str, str],
    style: FigureStyle,
) -> page.Section:
    asked = contents.configuration
    parts: list[Markup] = []
    if asked.get("datasets"):
        parts += [tag("h3", "Data sets"), datasets_html(asked, clouds, style)]
    if metrics is not None:
        parts += [tag("h3", "Codecs"), codecs_html(asked, metrics, style)]
    parts += [tag("h3", "This page was made with"), machine_html(machine, metrics)]
    if asked:
        parts.append(configuration_html(asked))
    return page.Section("run", "The run", joined(parts))


def _tables(
    contents: Contents, tables: Mapping[str, pd.DataFrame], folder: Path
) -> Iterator[page.TableShown]:
    for name, table in tables.items():
        html = table_html(table, _link(Path(contents.tables[name]), folder))
        yield page.TableShown(name, TITLES.get(name, name), html, _caption(contents, name))


def _figures(contents: Contents, folder: Path) -> Iterator[page.FigureShown]:
    for name, file in contents.figures.items():
        entry = figure_entry(name)
        yield page.FigureShown(
            name,
            f"{entry.thesis} {entry.title}".strip(),
            entry.thesis[:1],
            embedded(read_bytes(Path(file)), file),
            _caption(contents, name),
            _link(Path(file).with_suffix(".pdf"), folder),
        )


def _caption(contents: Contents, name: str) -> Markup:
    if contents.captions is None:
        return Markup("")
    file = Path(contents.captions) / f"{_CAPTION_FILES.get(name, name)}.rst"
    return caption_html(read_bytes(file).decode("utf-8")) if file.exists() else Markup("")


def _link(file: Path, folder: Path) -> str:
    """The way from the page's folder to a file below it; the bare name of any other."""
    return file.relative_to(folder).as_posix() if file.is_relative_to(folder) else file.name


def viewer_payload(
    contents: Contents, metrics: pd.DataFrame | None, style: FigureStyle
) -> dict[str, Any]:
    """What the viewer shows: examples, looks of their codecs, colour maps."""
    clouds = sum(1 + sum(map(len, e.decoded.values())) for e in contents.examples)
    points = points_each(contents.points, clouds, contents.most_mb)
    codecs = style.ordered_codecs(c for example in contents.examples for c in example.decoded)
    return {
        "codecs": [codec_look(name, style) for name in codecs],
        "maps": {name: _colours(*which) for name, which in _COLOUR_MAPS.items()},
        "examples": [_example(item, points, metrics, style) for item in contents.examples],
    }


def _example(
    example: Example, points: int, metrics: pd.DataFrame | None, style: FigureStyle
) -> dict[str, Any]:
    original = read_cloud(Path(example.original))
    coded = (
        (codec, rate, read_cloud(Path(file)).xyz)
        for codec, files in example.decoded.items()
        for rate, file in files.items()
    )
    decoded = shown_decoded(original, coded, points)
    payload = example_payload(shown_original(original, points), decoded, "scale" in original.about)
    for item in payload["decoded"]:
        item["bpp"] = _bpp(metrics, example, item["codec"], item["rate"])
    return {
        "title": f"{style.title(example.dataset)}: {example.cloud}",
        "opened": example.kind != "object",
        **payload,
    }


def _bpp(metrics: pd.DataFrame | None, example: Example, codec: str, rate: str) -> float | None:
    if metrics is None:
        return None
    row = metrics[
        (metrics["dataset"] == example.dataset)
        & (metrics["cloud"] == example.cloud)
        & (metrics["codec"] == codec)
        & (metrics["rate"] == rate)
    ]
    return float(f"{row['bpp'].iloc[0]:.4g}") if len(row) else None


def _colours(name: str, start: float) -> list[str]:
    import matplotlib
    from matplotlib.colors import to_hex

    shares = (start + (1 - start) * step / (_COLOUR_STOPS - 1) for step in range(_COLOUR_STOPS))
    return [to_hex(matplotlib.colormaps[name](share)) for share in shares]
