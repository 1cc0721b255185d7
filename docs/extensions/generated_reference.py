"""Reference pages from the program itself.

A line ``<!-- generated: codecs -->`` of a page is replaced by what the function of that name below
returns, in Markdown.
"""

import dataclasses
import re
from collections.abc import Callable, Iterable
from importlib.resources import files
from typing import Any

from pygments.lexers.python import PythonLexer

MARKER = re.compile(r"<!-- generated: (\w+) -->")


def setup(app: Any) -> dict[str, bool]:
    """Register with Sphinx."""
    app.add_lexer("snakemake", PythonLexer)
    app.connect("source-read", _replaced)
    return {"parallel_read_safe": True}


def _replaced(_app: Any, _page: str, source: list[str]) -> None:
    source[0] = MARKER.sub(lambda found: GENERATED[found[1]](), source[0])


def command_line() -> str:
    """Every command with its arguments, as its `--help` prints them."""
    from puckbench.cli import COMMANDS

    return "\n\n".join(
        f"## puckbench {name}\n\n{_sentence(text)}\n\n```text\n{_help(name)}\n```"
        for name, text in COMMANDS.items()
    )


def _help(name: str) -> str:
    from puckbench.cli import _parser

    parser, _ = _parser([name])
    commands = next(action for action in parser._actions if action.metavar == "COMMAND")
    command = commands.choices[name]
    command.description = None
    return str(command.format_help().rstrip())


def codecs() -> str:
    """Every codec with its title, options and rates."""
    from puckbench.codecs.registry import entries

    shown = entries()
    return _table(
        ["codec", "options and their defaults", "rates"],
        (
            (f"`{name}`", _values(about.get("options", {})), _rates(about["rates"]))
            for name, about in shown.items()
        ),
    )


def trainings() -> str:
    """The settings of the training of every learned codec."""
    from puckbench.codecs.registry import entries, has_weights, training_class
    from puckbench.core.registry import load

    shown = {name: load(training_class(name), name) for name in entries() if has_weights(name)}
    return _table(
        ["codec", "settings and their defaults"],
        ((f"`{name}`", _values(_options(model))) for name, model in shown.items()),
    )


def error_models() -> str:
    """Every error model with what it does, and its parameters."""
    from puckbench.core.registry import load
    from puckbench.lidar.errors import REGISTRY

    models = {name: (load(place, name), preset) for name, (place, preset) in REGISTRY.items()}
    return _table(
        ["model", "what", "parameters and their defaults"],
        (
            (f"`{name}`", _first_sentence(model), _values({**_options(model), **preset}))
            for name, (model, preset) in models.items()
        ),
    )


def sensors() -> str:
    """Every shipped sensor."""
    from puckbench.lidar.sensor import load_sensor

    names = sorted(
        path.name.removesuffix(".yaml")
        for path in files("puckbench.lidar").joinpath("sensors").iterdir()
        if path.name.endswith(".yaml")
    )
    shown = {name: load_sensor(name) for name in names}
    return _table(
        ["sensor", "device", "lasers", "turns per second", "azimuth step", "greatest range"],
        (
            (
                f"`{name}`",
                f"{sensor.manufacturer} {sensor.name}",
                sensor.lasers,
                f"{sensor.rotation_hz:g}",
                f"{sensor.azimuth_step_deg:g}°",
                f"{sensor.max_range_m:g} m",
            )
            for name, sensor in shown.items()
        ),
    )


def data_sets() -> str:
    """Every loader with what it reads, and its options."""
    from puckbench.datasets.registry import LOADERS

    shown = {name: LOADERS.get(name) for name in LOADERS.names()}
    return _table(
        ["loader", "what", "options and their defaults"],
        (
            (f"`{name}`", _first_sentence(loader), _values(_options(loader)))
            for name, loader in sorted(shown.items())
        ),
    )


def tables() -> str:
    """Every table that is made from others."""
    from puckbench.thesis.tables import REGISTRY, RESULTS, VERDICTS

    def table_entries() -> dict[str, Any]:
        return {**REGISTRY, **RESULTS, **VERDICTS}

    return _table(
        ["table", "made from"],
        (
            (f"`{name}`", ", ".join(f"`{item}`" for item in (*entry.inputs, *entry.optional)))
            for name, entry in table_entries().items()
        ),
    )


def figures() -> str:
    """Every figure with its title."""
    from puckbench.figures.registry import FIGURES

    def figure_entries() -> dict[str, Any]:
        return FIGURES

    return _table(
        ["figure", "title", "group", "thesis"],
        (
            (f"`{name}`", entry.title, entry.category, entry.thesis)
            for name, entry in figure_entries().items()
        ),
    )


def _table(titles: Iterable[str], rows: Iterable[Iterable[Any]]) -> str:
    titles = list(titles)
    return "\n".join(
        "| " + " | ".join(str(cell).replace("|", "\\|") for cell in row) + " |"
        for row in (titles, ["---"] * len(titles), *rows)
    )


def _options(model: Any) -> dict[str, Any]:
    """Names and defaults of the options of a pydantic model or a data class."""
    if dataclasses.is_dataclass(model):
        shown = {field.name: _default(field) for field in dataclasses.fields(model)}
    else:
        shown = {
            name: "(required)" if field.is_required() else field.get_default()
            for name, field in model.model_fields.items()
        }
    return {name: value for name, value in shown.items() if not name.startswith("_")}


def _default(field: "dataclasses.Field[Any]") -> Any:
    if field.default_factory is not dataclasses.MISSING:
        return field.default_factory()
    return "(required)" if field.default is dataclasses.MISSING else field.default


def _values(options: dict[str, Any]) -> str:
    return ", ".join(f"`{name}` {_value(value)}".rstrip() for name, value in options.items())


def _value(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return str(value).lower()
    return "" if isinstance(value, dict | tuple | list) and not value else str(value)


def _rates(rates: dict[str, Any]) -> str:
    return "<br>".join(f"{name}: {_values(dict(values))}" for name, values in rates.items())


def _first_sentence(target: Any) -> str:
    return re.split(r"(?<=[.:])\s", " ".join((target.__doc__ or "").split()))[0].replace("``", "`")


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}."


SHOWN = (command_line, codecs, trainings, error_models, sensors, data_sets, tables, figures)
GENERATED: dict[str, Callable[[], str]] = {function.__name__: function for function in SHOWN}
