"""The section of puckbench's report that shows each claim with its verdict and measurements."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from puckbench.report.sections import SECTIONS, SectionData
from puckbench.tables.cells import cell_text

if TYPE_CHECKING:
    from markupsafe import Markup

CODE = ()

_COLOURS = {"holds": "good", "holds in part": "partly", "does not hold": "bad"}
_UNTESTED = "not tested"
_SEPARATOR = re.compile(r"; (?![^(]*\))")
"""Matches a semicolon outside parentheses."""
_HTML = """\
<p class="note">Published claims and the verdicts of this run:
{%- for verdict, count in counts.items() %} {{ count }} × {{ verdict }}
{{- "" if loop.last else "," }}{% endfor %}.
Table: <a href="{{ link }}">CSV</a>.</p>
<div class="cards">
{% for card in cards %}
<article class="card marked claim {{ card.colour }}">
<h3><span class="verdict">{{ card.verdict }}</span> {{ card.heading }}</h3>
<p>{{ card.text }}</p>
{% if card.remark %}<p class="remark">{{ card.remark }}</p>{% endif %}
{% if card.measured or card.context %}
<details><summary>What was measured</summary>
<ul>{% for part in card.measured %}<li>{{ part }}</li>{% endfor %}</ul>
<dl>{% for head, text in card.context.items() %}
<dt>{{ head }}</dt><dd>{{ text }}</dd>
{%- endfor %}</dl></details>
{% endif %}
{% if card.figures %}
<p class="remark">Figures: {% for figure, title in card.figures.items() %}
<a href="#figure-{{ figure }}">{{ title }}</a>{{ "" if loop.last else "; " }}
{%- endfor %}</p>
{% endif %}
</article>
{% endfor %}
</div>
"""


@SECTIONS.register("claims", title="Claims", tables=("claims",))
def claims_section(data: SectionData) -> Markup | None:
    """Return the claims of the thesis as HTML, or None if no claim was tested."""
    from puckbench.report.page import filled

    rows = data.tables["claims"].to_dict("records")
    texts = [{str(key): cell_text(value) for key, value in row.items()} for row in rows]
    cards = [_card(row, data.figures) for row in texts]
    counts = Counter(card["verdict"] for card in cards)
    if not counts.keys() - {_UNTESTED}:
        return None
    return filled(_HTML, cards=cards, counts=counts, link=data.links["claims"])


def _card(row: Mapping[str, str], figures: Mapping[str, str]) -> dict[str, Any]:
    verdict, *remark = re.split(r"[:;] ", row["verdict"], maxsplit=1)
    context = {
        "Published": row.get("thesis"),
        "By the published numbers": row.get("thesis_verdict"),
        "Could not be tested without": row.get("not_tested") if verdict != _UNTESTED else None,
    }
    names = row.get("figure", "").split(", ")
    return {
        "heading": f"{row['number']} · Section {row['section']}",
        "verdict": verdict,
        "remark": "".join(remark),
        "colour": _COLOURS.get(verdict, "open"),
        "text": row["claim"],
        "measured": measured_parts(row.get("here", "")),
        "context": {head: text for head, text in context.items() if text},
        "figures": {name: figures[name] for name in names if name in figures},
    }


def measured_parts(text: str) -> list[str]:
    """Split the measurements of a claim (column ``here``) into the results of its tests."""
    return [part for part in _SEPARATOR.split(text) if part]
