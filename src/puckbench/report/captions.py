"""Captions, written in a small part of reStructuredText, as HTML."""

from __future__ import annotations

import re
from html import escape

from puckbench.report.markup import Markup

_SPANS = ((r"``(.+?)``", r"<code>\1</code>"), (r"\*([^*\s][^*]*)\*", r"<em>\1</em>"))


def caption_html(text: str) -> Markup:
    """Paragraphs of a caption, with ``code`` and *emphasis*; everything else is plain text."""
    paragraphs = re.split(r"\n\s*\n", text.strip())
    return Markup("".join(f"<p>{_spans(' '.join(p.split()))}</p>" for p in paragraphs if p))


def _spans(line: str) -> str:
    html = escape(line, quote=False)
    for pattern, replacement in _SPANS:
        html = re.sub(pattern, replacement, html)
    return html
