"""Reference pages from the program itself.

A line ``<!-- generated: codecs -->`` of a page is replaced by what the function of that name below
returns, in Markdown.
"""

import dataclasses
import math
import re
import subprocess
import sys
import tokenize
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from html import escape
from importlib.resources import files
from inspect import cleandoc, get_annotations
from pathlib import Path
from typing import Any

from pydantic import BaseModel
from pygments.lexers.python import PythonLexer

SOURCE = Path(__file__).parents[2] / "src"
MARKER = re.compile(r"<!-- generated: (\w+) -->")


def setup(app: Any) -> dict[str, bool]:
    """Register with Sphinx."""
    app.add_lexer("snakemake", PythonLexer)
    app.connect("source-read", _replaced)
    app.connect("build-finished", _with_studies)
    return {"parallel_read_safe": True}


def _replaced(app: Any, _page: str, source: list[str]) -> None:
    if MARKER.search(source[0]):
        source[0] = MARKER.sub(lambda found: GENERATED[found[1]](), source[0])
        app.env.note_reread()  # it is not this page alone that may change until the next build


def _with_studies(app: Any, fault: Exception | None) -> None:
    """Put the pages of the reference results into the site.

    In a process of its own: here Sphinx has its own directives in place of those of docutils.
    """
    if fault is None and app.builder.format == "html":
        folder = str(Path(app.outdir) / "reference" / "results")
        subprocess.run([sys.executable, "-m", "puckbench.report.leaderboard", folder], check=True)


def packages() -> str:
    """Every package of the repository: what it is, what it needs, and how long it is."""
    projects = {
        path.parent: tomllib.loads(path.read_text(encoding="utf-8"))["project"]
        for path in sorted(SOURCE.glob("*/pyproject.toml"))
    }
    rows = []
    for folder, project in projects.items():
        needed = [re.split(r"[^\w.-]", line)[0] for line in project["dependencies"]]
        ours = [name for name in needed if SOURCE / name in projects]
        others = dict.fromkeys(name for name in needed if name not in ours)
        lines = sum(map(_code_lines, folder.rglob("*.py")))
        cells = [f"`{folder.name}`", project["description"], _names(ours), ", ".join(others)]
        rows.append([*cells, f"{lines:,}"])
    return _table(["package", "what it is", "imports", "needs besides", "lines of code"], rows)


def _code_lines(path: Path) -> int:
    """Lines of a module that have code: not blank lines, comments and texts by themselves."""
    lines: set[int] = set()
    statement: list[tokenize.TokenInfo] = []
    with tokenize.open(path) as file:
        for token in tokenize.generate_tokens(file.readline):
            if token.type not in {tokenize.COMMENT, tokenize.NL, tokenize.INDENT, tokenize.DEDENT}:
                statement.append(token)
            if token.type == tokenize.NEWLINE:
                if [each.type for each in statement] != [tokenize.STRING, tokenize.NEWLINE]:
                    lines |= {n for t in statement for n in range(t.start[0], t.end[0] + 1)}
                statement = []
    return len(lines)


def results() -> str:
    """The reference results of every study: all codecs on each data set."""
    from puckbench.report.reference_results import read_reference, shipped_studies

    studies = [read_reference(name) for name in shipped_studies()]
    return "\n\n".join(map(_study, studies)) or "This version comes with none yet."


def _study(reference: Any) -> str:
    """A study with its findings, and the way to its page."""
    from puckbench.report.leaderboard import study_findings

    found = study_findings(reference)
    facts = "; ".join(f"{name}: {text}" for name, text in reference.record.facts().items())
    folder = f"results/{reference.name}"
    page = f'<p><a href="{folder}/index.html">Curves, tables, and how they were made</a>'
    page += f' (<a href="{folder}/tables/metrics.csv">all rows</a>)</p>'
    lines = [f"## {reference.title} (`{reference.name}`)", f"{facts}.", page]
    told = [f"Not timed: {escape(reference.not_timed)}."] if reference.not_timed else []
    lines += [*told, _uses(found.uses)] if found.uses else told
    if found.anchor:
        lines += [f"BD-rates are against {found.anchor}."]
    for dataset in found.datasets:
        clouds = "1 cloud" if dataset.clouds == 1 else f"{dataset.clouds} clouds"
        statements = [f"* {head}: {text}." for head, text in dataset.statements.items() if text]
        lines += [f"### {dataset.title}, {clouds}", "\n".join(statements), _deltas(dataset)]
    return "\n\n".join(filter(None, lines))


def _uses(rows: Iterable[Any]) -> str:
    """The best codec for each use, as a table."""
    shown = {
        "Use": "use", "Clouds": "clouds", "Codec": "codec", "Bits per point": "bits",
        "Error": "error", "Largest error": "largest", "Scenes": "scenes", "Verdict": "verdict",
    }  # fmt: skip
    return _html_table(
        list(shown), [[(getattr(row, k), "") for k in shown.values()] for row in rows]
    )


def _deltas(dataset: Any) -> str:
    """The BD-rates of a data set's codecs, as a table."""
    columns = dataset.columns.values()
    rows = [
        [(codec["title"], ""), *((cell.text, cell.note) for cell in cells)]
        for codec in dataset.codecs
        for cells in [[column[codec["name"]] for column in columns]]
    ]
    return _html_table(["Codec", *dataset.columns], rows)


def _html_table(heads: Sequence[str], rows: Iterable[Sequence[tuple[str, str]]]) -> str:
    """Rows of values with remarks below, as HTML that a narrow window shows as cards."""
    head = "".join(f'<th scope="col">{escape(text)}</th>' for text in heads)
    body = "\n".join(
        f'<tr><th scope="row">{escape(cells[0][0])}</th>'
        + "".join(
            f'<td data-head="{escape(name)}">{escape(text)}'
            f"{f'<small>{escape(note)}</small>' if note else ''}</td>"
            for name, (text, note) in zip(heads[1:], cells[1:], strict=True)
        )
        + "</tr>"
        for cells in rows
    )
    return (
        f'<table class="docutils ranking">\n<thead><tr>{head}</tr></thead>\n'
        f"<tbody>\n{body}\n</tbody></table>"
    )


def published() -> str:
    """The sources of published numbers, and the BD-rates that they print, computed again."""
    from puckbench.published_sources.registry import all_sources

    return "\n\n".join(map(_source, all_sources()))


def _source(source: Any) -> str:
    """A source of published numbers: what it has, and whether its BD-rates come out again."""
    from puckbench.published_sources.bd_rates import checked_bd_rates, repeated_curves

    rows = source.rows
    curves = rows[["dataset", "cloud", "codec", "codec_version", "measure"]].drop_duplicates()
    names = ", ".join(f"`{name}`" for name in sorted(set(rows["dataset"])))
    facts = f"{source.address} ({source.licence}); {len(rows):,} numbers, {len(curves):,} curves"
    same = repeated_curves(source)[["codec", "cloud", "same_as"]].drop_duplicates()
    pairs = [f"{codec}, {cloud} and {other}" for codec, cloud, other in same.to_numpy()]
    parts = [
        f"## {source.title} (`{source.name}`)",
        " ".join(filter(None, [_first_sentence(source.read), f"{facts}.", source.remark])),
        f"Data sets: {names}.",
        _checked_bd_rates(checked_bd_rates(source).to_dict("records"), source.interpolation),
        f"Clouds with the same curve, number for number: {'; '.join(pairs)}." if pairs else "",
    ]
    return "\n\n".join(filter(None, parts))


def _checked_bd_rates(rows: Sequence[Mapping[str, Any]], interpolation: str) -> str:
    """Printed BD-rates beside those computed from the source's own curves."""
    if not rows:
        return ""
    equal = sum(row["difference"] == 0 for row in rows)
    method = interpolation or "PCHIP, since it names none"
    text = f"Of {len(rows)} printed BD-rates, {equal} come out again to the printed digit from the "
    text += f"curves of the source, by its interpolation ({method})."
    without = sum(math.isnan(row["again"]) for row in rows)
    text += f" Of {without}, the source has no curve." if without else ""
    heads = ["cloud", "codec", "against", "metric, rates", "printed", "again", "difference"]
    lines = [
        (
            f"{row['dataset']}, {row['cloud']}",
            row["codec"],
            row["anchor"],
            f"{row['measure'].removeprefix('bd_rate_').upper()}, {row['rate']}",
            *(_percent(row[name], "") for name in ("printed", "again")),
            _percent(row["difference"], "") if row["difference"] else "",
            _percent(row["pchip"], row["status"]),
        )
        for row in rows
    ]
    return f"{text}\n\n{_table([*heads, 'PCHIP'], lines)}"


def _percent(value: float, otherwise: str) -> str:
    return otherwise if math.isnan(value) else f"{round(value, 3):g} %"


def command_line() -> str:
    """Every command with its arguments, as its `--help` prints them."""
    from puckbench.cli.registry import help_texts

    return "\n\n".join(
        f"## puckbench {name}\n\n{_sentence(text)}\n\n```text\n{_help(name)}\n```"
        for name, text in help_texts().items()
    )


def _help(name: str) -> str:
    from puckbench.cli import _parser

    parser, _ = _parser([name])
    commands = next(action for action in parser._actions if action.metavar == "COMMAND")
    command = commands.choices[name]
    command.description = None
    return str(command.format_help().rstrip())


def codecs() -> str:
    """Every codec with what it is, its options, and its rates."""
    from puckbench.codecs.registry import codecs, look

    shown = codecs()
    rates = ((f"`{name}`", _rates(codec.rates)) for name, codec in shown.items())
    options = _table(
        ["codec", "title", "what", "options and their defaults"],
        (
            (f"`{name}`", look(name).title, _first_sentence(codec), _lines(codec.Options))
            for name, codec in shown.items()
        ),
    )
    return f"{options}\n\n## Rates\n\n{_table(['codec', 'rates'], rates)}"


def trainings() -> str:
    """The settings of the training of every learned codec."""
    from pointkit.registry import load
    from puckbench.codecs.registry import codecs, has_weights, training_class

    shown = {name: load(training_class(name), name) for name in codecs() if has_weights(name)}
    return _plugins(shown)


def error_models() -> str:
    """Every error model with what it does, and its parameters."""
    from virtual_lidar.errors import ERROR_MODELS

    return _plugins({name: ERROR_MODELS.get(name) for name in ERROR_MODELS.names()})


def capture_options() -> str:
    """The options of a recording's residuals, and the limits of its planes."""
    from virtual_lidar.walls.detection import PlaneSearch
    from virtual_lidar.walls.residuals import RecordingOptions

    return f"{_grouped(RecordingOptions, {})}\n\n## `search`\n\n{_grouped(PlaneSearch, {})}"


def capture_columns() -> str:
    """The columns of a table of returns, of all sensors and of some."""
    from pointkit.lidar.return_table import FURTHER_COLUMNS, RETURN_COLUMNS

    titles = ["column", "type", "unit", "meaning"]
    tables = [
        _table(titles, ((f"`{name}`", *spec) for name, spec in columns.items()))
        for columns in (RETURN_COLUMNS, FURTHER_COLUMNS)
    ]
    return f"{tables[0]}\n\n## Of an Ouster only\n\n{tables[1]}"


def sensors() -> str:
    """Every shipped sensor."""
    from pointkit.lidar.sensor import load_sensor

    names = sorted(
        path.name.removesuffix(".yaml")
        for path in files("pointkit.lidar").joinpath("sensors").iterdir()
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


def scene_sets() -> str:
    """Every loader with what it reads, and its options."""
    from puckbench.scene_sets.registry import LOADERS

    return _plugins({name: LOADERS.get(name) for name in sorted(LOADERS.names())})


def tables() -> str:
    """Every table with its title, and what it is made from."""
    from puckbench.tables.registry import table_entries

    return _table(
        ["table", "title", "group", "made from"],
        (
            (f"`{name}`", entry.title, entry.category, _names((*entry.inputs, *entry.optional)))
            for name, entry in table_entries().items()
        ),
    )


def figures() -> str:
    """Every figure with its title, and what it is drawn from."""
    from puckbench.figures.registry import figure_entries

    return _table(
        ["figure", "title", "group", "drawn from", "thesis"],
        (
            (f"`{name}`", entry.title, entry.category, _names(entry.inputs), entry.number)
            for name, entry in figure_entries().items()
        ),
    )


def _names(names: Iterable[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def _table(titles: Iterable[str], rows: Iterable[Iterable[Any]]) -> str:
    titles = list(titles)
    return "\n".join(
        "| " + " | ".join(str(cell).replace("|", "\\|") for cell in row) + " |"
        for row in (titles, ["---"] * len(titles), *rows)
    )


def _plugins(plugins: Mapping[str, Any]) -> str:
    """A section for each plug-in: what it is, and its options."""
    names = {plugin: name for name, plugin in plugins.items()}
    return "\n\n".join(
        f"## `{name}`\n\n{_renamed(_first_sentence(plugin), names)}\n\n{_grouped(plugin, names)}"
        for name, plugin in plugins.items()
    )


def _renamed(text: str, names: Mapping[Any, str]) -> str:
    """A text that names plug-ins as a configuration does, not by their classes."""
    classes = {plugin.__name__: name for plugin, name in names.items()}
    return re.sub(r"`(\w+)`", lambda found: f"`{classes.get(found[1], found[1])}`", text)


def _grouped(model: Any, names: Mapping[Any, str]) -> str:
    """The options of a plug-in as a list, those of one meaning together, and shared ones last."""
    groups: dict[str, list[str]] = {}
    for name, default, meaning in _options(model, tuple(names)):
        groups.setdefault(meaning, []).append(f"`{name}` ({default})")
    shared = groups.pop("", [])
    lines = [f"* {', '.join(options)}: {meaning}" for meaning, options in groups.items()]
    if shared:
        bases = [f"`{names[kind]}`" for kind in model.__mro__[1:] if kind in names]
        lines.append(f"* {', '.join(shared)}{f': as in {bases[0]}' if bases else ''}")
    return "\n".join(lines)


def _options(model: Any, others: tuple[Any, ...] = ()) -> list[tuple[str, str, str]]:
    """Name, default and meaning of the options of a pydantic model or a data class.

    Those that it shares with one of the others have no meaning here: they are explained there.
    """
    if dataclasses.is_dataclass(model):
        shown = {field.name: (_default(field), None) for field in dataclasses.fields(model)}
    else:
        shown = {
            name: ("required" if field.is_required() else field.get_default(), field.description)
            for name, field in model.model_fields.items()
        }
    kinds = [kind for kind in model.__mro__ if kind is model or kind not in others]
    meant = _parameters(kinds)
    declared = {name for kind in kinds for name in get_annotations(kind)}
    return [
        (name, _value(default), _one_line(about if name in declared else "") or meant.get(name, ""))
        for name, (default, about) in shown.items()
    ]


def _lines(model: Any) -> str:
    """The options of a model, one to a line of a table."""
    return "<br>".join(
        f"`{name}` {default}{f': {meaning}' if meaning else ''}"
        for name, default, meaning in _options(model)
    )


def _parameters(kinds: Iterable[type]) -> dict[str, str]:
    """The meanings of parameters in the docstrings of some classes; the first class counts most."""
    meant: dict[str, str] = {}
    for kind in reversed(list(kinds)):
        _, _, section = cleandoc(vars(kind).get("__doc__") or "").partition(
            "Parameters\n----------\n"
        )
        for names, text in re.findall(r"^(\S.*)\n((?: +.*\n?)+)", section, re.MULTILINE):
            words = _one_line(text).rstrip(".")
            meant |= dict.fromkeys(names.split(", "), words[:1].lower() + words[1:])
    return meant


def _one_line(text: str | None) -> str:
    return " ".join((text or "").split()).replace("``", "`")


def _default(field: "dataclasses.Field[Any]") -> Any:
    if field.default_factory is not dataclasses.MISSING:
        return field.default_factory()
    return "required" if field.default is dataclasses.MISSING else field.default


def _values(options: Mapping[str, Any]) -> str:
    return ", ".join(f"`{name}` {_value(value)}" for name, value in options.items())


def _value(value: Any) -> str:
    if value is None:
        return "none"
    if isinstance(value, bool):
        return str(value).lower()
    return "see below" if isinstance(value, BaseModel) else str(value)


def _rates(rates: Mapping[str, Any]) -> str:
    return "<br>".join(f"{name}: {_values(values)}" for name, values in rates.items())


def _first_sentence(target: Any) -> str:
    words = " ".join((target.__doc__ or "").split())
    sentence = re.split(r"(?<=[.:])\s", words)[0].replace("``", "`")
    return re.sub(r":$", ".", sentence)


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}."


SHOWN = (
    command_line,
    codecs,
    trainings,
    error_models,
    capture_columns,
    capture_options,
    sensors,
    scene_sets,
    tables,
    figures,
    results,
    published,
    packages,
)
GENERATED: dict[str, Callable[[], str]] = {function.__name__: function for function in SHOWN}
