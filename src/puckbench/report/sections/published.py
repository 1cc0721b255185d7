"""The section of the report that shows this run's curves beside published ones."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from puckbench.report.sections import SECTIONS, SectionData

if TYPE_CHECKING:
    import pandas as pd
    from markupsafe import Markup

_HTML = """\
<p class="note">Curves of this run beside curves that others published of the same data set, with
their conditions. A mark in brackets names the differences of a published curve: do not read it as
one with this run's. Points of all curves: <a href="{{ link }}">CSV</a>.</p>
{% for title, rows in tables.items() %}
<h3>{{ title }}</h3>
<div class="scroll" tabindex="0"><table class="data"><thead><tr>
{%- for head in heads %}<th scope="col">{{ head }}</th>{% endfor %}</tr></thead><tbody>
{% for row in rows %}
<tr>{% for text in row %}<td>{{ text }}</td>{% endfor %}</tr>
{% endfor %}
</tbody></table></div>
{% endfor %}
<dl>{% for differs, mark in marks.items() %}
<dt>{{ mark }}</dt><dd>{{ differs }}</dd>
{%- endfor %}</dl>
"""


@SECTIONS.register("published", title="Beside published numbers", tables=("published",))
def published_section(data: SectionData) -> Markup | None:
    """Return this run's curves and the published ones as HTML."""
    from puckbench.published_sources.beside import marks_of
    from puckbench.published_sources.curve_rows import HEADS, tables_of_curves
    from puckbench.report.page import filled

    points: pd.DataFrame = data.tables["published"]
    tables: Mapping[str, Any] = tables_of_curves(points)
    marks = marks_of(points)
    return filled(_HTML, tables=tables, heads=HEADS, marks=marks, link=data.links["published"])
