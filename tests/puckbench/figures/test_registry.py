"""Figures and tables are registered one way: ours, those of a user's file, of another package."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd
import pytest

from pointkit.registry import trust
from puckbench.cli import main
from puckbench.figures.registry import FIGURES, figure_entries, figure_entry
from puckbench.tables.registry import TABLES, table_entry

FIGURE = '''
from __future__ import annotations
from typing import TYPE_CHECKING
from puckbench.figures.registry import FIGURES
if TYPE_CHECKING:
    import pandas as pd
    from pointkit.geometry.cloud import PointCloud

@FIGURES.register("sizes", title="Sizes", category="Mine", number="6.45")
def draw_sizes(clouds: pd.DataFrame, example_raw: PointCloud, style):
    """Points of *each* cloud.

    Notes
    -----
    Not for readers.
    """
'''
DRAWN = '''
from matplotlib.figure import Figure
def draw(clouds: "pd.DataFrame", style):
    """No registration at all."""
    figure = Figure(figsize=(2, 2))
    figure.subplots().plot(clouds["points"])
    return figure
'''
TABLE = '''
from puckbench.tables.registry import TABLES
@TABLES.register("counts", title="Counts")
def counts(clouds: "pd.DataFrame", metrics: "pd.DataFrame | None" = None, *, factor: float = 1):
    """How many points."""
    return clouds.groupby("dataset")["points"].sum().mul(factor).reset_index()
'''


def test_figures_are_in_the_order_of_their_numbers() -> None:
    entries = figure_entries()
    chapters = [name for name, entry in entries.items() if entry.number]
    expected = [f"fig_5_{n}" for n in range(1, 22)] + [f"fig_6_{n}" for n in range(1, 10)]
    assert chapters == expected
    assert list(entries)[: len(expected)] == expected


def test_a_figures_parameters_are_its_inputs_and_its_docstring_the_caption(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(FIGURE)
    trust([f"{file}:draw_sizes"])
    entry = figure_entry(f"{file}:draw_sizes")
    assert (entry.name, entry.title, entry.category) == ("sizes", "Sizes", "Mine")
    assert entry.kinds == {"clouds": "DataFrame", "example_raw": "PointCloud"}
    assert entry.caption == "Points of *each* cloud."
    assert FIGURES.module_of(f"{file}:draw_sizes") == str(file)


def test_a_figure_of_a_users_file_is_drawn(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(DRAWN)
    table = tmp_path / "clouds.csv"
    pd.DataFrame({"dataset": "a", "points": [1, 2]}).to_csv(table, index=False)
    out = tmp_path / "mine.png"
    words = [
        f"{tmp_path / 'mine.py'}:draw",
        str(out),
        "--inputs",
        json.dumps({"clouds": str(table)}),
    ]
    assert main(["figure", *words]) == 0
    assert out.read_bytes().startswith(b"\x89PNG")


def test_a_figure_takes_the_style_of_codecs_from_a_file_and_is_written_as_svg(
    tmp_path: Path,
) -> None:
    rows = [
        {"dataset": "objects", "cloud": "a", "codec": codec, "rate": f"r{rate}", "bpp": rate}
        | {"cd_plane": 4 - rate, "frame": "scaled"}
        for codec in ("draco", "gpcc")
        for rate in (1, 2, 3)
    ]
    pd.DataFrame(rows).to_csv(tmp_path / "metrics.csv", index=False)
    style = tmp_path / "style.yaml"
    style.write_text('colours: {draco: "#123456"}\ncodec_titles: {draco: My title}\n')
    outputs = [tmp_path / "a.svg", tmp_path / "b.svg"]
    inputs = json.dumps({"metrics": str(tmp_path / "metrics.csv")})
    for out in outputs:
        assert main(["figure", "fig_6_6", str(out), "--inputs", inputs, "--style", str(style)]) == 0
    svg, again = (out.read_text() for out in outputs)
    assert svg == again
    assert svg.startswith("<?xml")
    assert "#123456" in svg


def test_the_help_of_figure_says_what_each_shows(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["figure", "--help"])
    lines = capsys.readouterr().out.splitlines()
    for name, entry in figure_entries().items():
        (line,) = [line for line in lines if line.startswith(f"  {name} ")]
        assert line.split(maxsplit=1)[1] == f"{entry.title} ({', '.join(entry.inputs)})"


def test_a_table_of_a_users_file_is_made(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, clouds, out = (tmp_path / name for name in ("mine.py", "clouds.csv", "out.csv"))
    file.write_text(TABLE)
    pd.DataFrame({"dataset": "a", "points": [1, 2]}).to_csv(clouds, index=False)
    trust([f"{file}:counts"])
    entry = table_entry(f"{file}:counts")
    assert (entry.name, entry.inputs, entry.optional) == ("counts", ("clouds",), ("metrics",))
    words = [f"{file}:counts", str(out), "--inputs", json.dumps({"clouds": str(clouds)})]
    assert main(["table", *words, "--options", '{"factor": 2}']) == 0
    assert pd.read_csv(out)["points"].tolist() == [6]
    capsys.readouterr()
    assert main(["table", *words, "--options", '{"factors": 2}']) == 2
    assert "options: got an unexpected keyword argument 'factors'" in capsys.readouterr().err


def test_a_figure_of_an_installed_package_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "their_figures.py").write_text(FIGURE)
    about = tmp_path / "theirs-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: theirs\nVersion: 1.0\n")
    point = "[puckbench.figures]\nsizes = their_figures:draw_sizes\n"
    (about / "entry_points.txt").write_text(point)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(FIGURES.__dict__, "_installed", raising=False)
    names = list(figure_entries())
    assert names.index("sizes") == names.index("fig_6_9") + 1  # 6.45 comes after 6.9
    assert FIGURES.module_of("sizes") == "their_figures"
    monkeypatch.undo()
    FIGURES.__dict__.pop("_installed", None)
    assert "sizes" not in FIGURES


def test_every_figure_and_table_has_a_title_and_a_caption() -> None:
    for registry in (FIGURES, TABLES):
        for name in registry.names():
            entry = registry.get(name)
            assert entry.title, name
            assert len(entry.caption.split()) > 5, name
