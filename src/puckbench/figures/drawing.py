from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from cloud_files.clouds import read_cloud
from pointkit.errors import InputError, among
from pointkit.files import write_bytes
from pointkit.geometry.cloud import CoordinateFrame
from puckbench.figures.registry import figure_entry
from puckbench.figures.style import FigureStyle

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# No date, no program version: the same input gives the same bytes.
_NO_METADATA: dict[str, dict[str, Any]] = {
    ".pdf": {"Creator": None, "Producer": None, "CreationDate": None},
    ".png": {"Software": None},
    ".svg": {"Creator": None, "Date": None},
}


def draw_files(
    name: str,
    inputs: Mapping[str, Path],
    outputs: Sequence[Path],
    style: FigureStyle,
    only: Mapping[str, Sequence[str]] = MappingProxyType({}),
) -> None:
    """Draw a figure from files of tables and clouds, and write it to files.

    Parameters
    ----------
    name
        Name of a registered figure, or ``path/to/file.py:function``.
    inputs
        CSV or Parquet files of tables, and PLY files of clouds, by name of the figure's input.
    outputs
        Files to write, with the suffixes .pdf, .png or .svg.
    style
        Style of the figure.
    only
        Values to draw, by column of the tables (``codec``, ``dataset``); an empty sequence draws
        all values.

    Raises
    ------
    InputError
        An input is missing, unreadable or empty, or no table has a value in `only`.
    """
    entry = figure_entry(name)
    if missing := [needed for needed in entry.inputs if needed not in inputs]:
        raise InputError(f"figure {name}: needs the input {missing[0]!r}")
    for path in outputs:
        _metadata(path)
    values = {
        name: read_input(kind, inputs[name], entry.frame) for name, kind in entry.kinds.items()
    }
    for column, chosen in only.items():
        values = _selected(values, column, chosen)
    with style.context():
        figure = entry.draw(**values, style=style)
        lay_out(figure)
        for path in outputs:
            save_figure(figure, path)


def _selected(values: dict[str, Any], column: str, chosen: Sequence[str]) -> dict[str, Any]:
    tables = {
        name: value for name, value in values.items() if column in getattr(value, "columns", ())
    }
    present = sorted({str(value) for table in tables.values() for value in table[column]})
    for name in chosen:
        if name not in present:
            raise InputError(f"no {column} '{name}' in the tables{among(name, present)}")
    if not chosen:
        return values
    return values | {name: table[table[column].isin(chosen)] for name, table in tables.items()}


def read_input(kind: str, path: Path, frame: CoordinateFrame = "scaled") -> Any:
    """Read an input of a figure.

    Parameters
    ----------
    kind
        ``DataFrame`` for a table, or ``PointCloud`` for a cloud.
    path
        File of the table or cloud.
    frame
        Coordinate frame of the figure's clouds; only rows of a table in this frame are read.

    Returns
    -------
    pandas.DataFrame or PointCloud
        The table, or the cloud with its returns.
    """
    from pointkit.lidar.returns import with_returns
    from pointkit.tables import read_table
    from puckbench.metrics.coordinate_frames import rows_in_frame

    if kind == "DataFrame":
        return rows_in_frame(read_table(path), frame)
    return with_returns(read_cloud(path), path)


def lay_out(figure: Figure) -> None:
    """Compute the layout of a figure and fix it, so that all files of the figure look alike."""
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.execute(figure)
        figure.set_layout_engine("none")


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure to a file; call this inside `FigureStyle.context`.

    Parameters
    ----------
    figure
        The figure, after `lay_out`.
    path
        File to write, with the suffix .pdf, .png or .svg.

    Raises
    ------
    InputError
        The suffix is another one, or writing fails.
    """
    from matplotlib import rcParams
    from matplotlib.backends import backend_agg, backend_pdf, backend_svg

    metadata, kind, dpi = _metadata(path), path.suffix[1:], figure.dpi
    saved = rcParams["savefig.dpi"]
    canvases: dict[str, Any] = {
        "pdf": backend_pdf.FigureCanvasPdf,
        "png": backend_agg.FigureCanvasAgg,
        "svg": backend_svg.FigureCanvasSVG,
    }
    content = io.BytesIO()  # on a full disk, matplotlib would raise misleading errors
    # Figure.savefig would draw twice, first for the layout, which `lay_out` has computed.
    figure.set_dpi(dpi if saved == "figure" else saved)  # as Figure.savefig
    getattr(canvases[kind](figure), f"print_{kind}")(content, metadata=metadata)
    figure.set_dpi(dpi)  # vector formats change it
    write_bytes(path, content.getvalue())


def _metadata(path: Path) -> dict[str, Any]:
    if path.suffix not in _NO_METADATA:
        raise InputError(f"{path}: a figure is written as {', '.join(_NO_METADATA)}")
    return _NO_METADATA[path.suffix]
