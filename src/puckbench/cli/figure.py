from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from pointkit.yaml_files import read_yaml
from puckbench.cli.types import files_by_name, json_object, made_of_tables
from puckbench.figures.plot_styles import read_looks
from puckbench.figures.registry import figure_entries
from puckbench.steps.figure import Figure


def arguments(parser: argparse.ArgumentParser) -> None:
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    entries = figure_entries().items()
    lines = (f"  {name:18} {entry.title} ({', '.join(entry.inputs)})" for name, entry in entries)
    parser.epilog = "\n".join(["figures:", *lines])
    add = parser.add_argument
    add("figure", help="one of the figures below, or path/to/file.py:function")
    add("out", type=Path, nargs="+", help="files to write (.pdf, .png, .svg)")
    add("--inputs", type=json_object, required=True, help='JSON: {"metrics": "metrics.csv", ...}')
    example = '{"colours": {"draco": "#336699"}, "codec_titles": {"draco": "..."}}'
    text = f"changes to the style, as in a configuration: a YAML file, or JSON such as {example}"
    add("--style", type=_style, default=[], help=text)
    add("--codecs", nargs="+", default=[], help="draw only these codecs")
    add("--datasets", nargs="+", default=[], help="draw only these data sets")


def _style(text: str) -> Any:
    if text.endswith((".yaml", ".yml")):
        return read_yaml(Path(text))
    return json_object(text)


def run(options: argparse.Namespace) -> dict[str, Any]:
    layers = options.style if isinstance(options.style, list) else [options.style]
    inputs = files_by_name(options.inputs, "--inputs")
    looks = [read_looks(path.parent) for path in inputs.values()]
    step = Figure.create(
        figure=options.figure,
        style=(*filter(None, looks), *layers),
        codecs=tuple(options.codecs),
        datasets=tuple(options.datasets),
    )
    with made_of_tables(f"figure {options.figure}"):
        return step.run(tuple(options.out), **inputs)
