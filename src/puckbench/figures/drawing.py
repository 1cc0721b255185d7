from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from puckbench.core.errors import InputError
from puckbench.core.files import write_bytes
from puckbench.figures.registry import figure_entry
from puckbench.figures.style import FigureStyle
from puckbench.geometry.cloud import CoordinateFrame
from puckbench.io.clouds import read_cloud

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# No date, no program version: the same input gives the same bytes.
_NO_METADATA: dict[str, dict[str, Any]] = {
    ".pdf": {"Creator": None, "Producer": None, "CreationDate": None},
    ".png": {"Software": None},
    ".svg": {"Creator": None, "Date": None},
}


def draw_files(
    name: str, inputs: Mapping[str, Path], outputs: Sequence[Path], style: FigureStyle
) -> None:
    """Draw a registered figure, or ``path/to/file.py:function``, to .pdf, .png or .svg files.

    `inputs` are CSV or Parquet files of tables and PLY files of clouds. Raises InputError if an
    input is missing, unreadable or empty.
    """
    entry = figure_entry(name)
    if missing := [needed for needed in entry.inputs if needed not in inputs]:
        raise InputError(f"figure {name}: needs the input {missing[0]!r}")
    for path in outputs:
        _metadata(path)
    values = {
        name: read_input(kind, inputs[name], entry.frame) for name, kind in entry.kinds.items()
    }
    with style.context():
        figure = entry.draw(**values, style=style)
        lay_out(figure)
        for path in outputs:
            save_figure(figure, path)


def read_input(kind: str, path: Path, frame: CoordinateFrame = "scaled") -> Any:
    """Read a ``DataFrame`` (only rows in `frame`), or a ``PointCloud`` with its returns."""
    from puckbench.io.tables import read_table
    from puckbench.lidar.returns import with_returns
    from puckbench.metrics.coordinate_frames import rows_in_frame

    if kind == "DataFrame":
        return rows_in_frame(read_table(path), frame)
    return with_returns(read_cloud(path), path)


def lay_out(figure: Figure) -> None:
    """Compute the layout once, so that all files of a figure look alike."""
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.execute(figure)
        figure.set_layout_engine("none")


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure as .pdf, .png or .svg; call this inside `FigureStyle.context`.

    Raises InputError for another suffix or if writing fails.
    """
    metadata = _metadata(path)
    content = io.BytesIO()  # on a full disk, matplotlib would raise misleading errors
    figure.savefig(content, format=path.suffix[1:], metadata=metadata)
    write_bytes(path, content.getvalue())


def _metadata(path: Path) -> dict[str, Any]:
    if path.suffix not in _NO_METADATA:
        raise InputError(f"{path}: a figure is written as {', '.join(_NO_METADATA)}")
    return _NO_METADATA[path.suffix]
