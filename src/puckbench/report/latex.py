from __future__ import annotations

import re
from typing import TYPE_CHECKING

from puckbench.report.cells import cell_text
from puckbench.report.column_labels import table_heading

if TYPE_CHECKING:
    import pandas as pd

_SPECIAL = re.compile(r"[&%$#_{}]")
_REPLACED = {
    "\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
    "²": r"\textsuperscript{2}", "°": r"\textdegree{}", "−": "$-$", "\N{NO-BREAK SPACE}": "~",
}  # fmt: skip


def latex_table(table: pd.DataFrame) -> str:
    """Return a LaTeX table (booktabs) with units in its heading and four significant digits.

    Missing values are dashes; empty columns are left out.
    """
    shown = table.dropna(axis="columns", how="all")
    names = [str(name) for name in shown]
    headings = [table_heading(name, names) for name in names]
    heads = [f"{words} ({unit})" if unit else words for words, unit in headings]
    alignment = "".join("r" if shown[name].dtype.kind in "fiu" else "l" for name in names)
    rows = [[cell_text(value) or "--" for value in row] for row in shown.itertuples(index=False)]
    head, *body = (" & ".join(map(_escaped, cells)) + r" \\" for cells in [heads, *rows])
    lines = [rf"\begin{{tabular}}{{{alignment}}}", r"\toprule", head, r"\midrule", *body]
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}", ""])


def _escaped(text: str) -> str:
    escaped = _SPECIAL.sub(lambda match: "\\" + match[0], text.replace("\\", "\0"))
    for character, command in _REPLACED.items():
        escaped = escaped.replace("\0" if character == "\\" else character, command)
    return escaped
