from __future__ import annotations

from pathlib import Path
from typing import Any

from puckbench.core.code import CLOUD_FILES, TABLES
from puckbench.jobs.gathered_tables import OfNames
from puckbench.jobs.registry import JOBS

CODE = (*CLOUD_FILES, *TABLES, "puckbench.jobs.gathered_tables")


@JOBS.register("first_look")
class FirstLook(OfNames):
    """Draw the first figures of a run from the results of one codec.

    `style` has layers of options of the figures' style, each of which overrides earlier ones.
    """

    style: tuple[dict[str, Any], ...] = ()

    def run(self, results: Path, parquet: Path, out: tuple[Path, ...]) -> dict[str, Any]:
        """Write the table of results to `parquet`, draw the figures, and return the row count.

        `results` is the results folder. `out` are the files of the figures, each of which has the
        name of its figure.
        """
        from pointkit.tables import write_table
        from puckbench.figures.drawing import draw_files
        from puckbench.figures.style import FigureStyle
        from puckbench.tables.gathered import metrics

        table = metrics(self.files(results))
        write_table(table, parquet)
        style = FigureStyle.from_config(*self.style)
        for path in out:
            draw_files(path.stem, {"metrics": parquet}, [path], style)
        return {"rows": len(table)}
