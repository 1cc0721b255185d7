from __future__ import annotations

from typing import TYPE_CHECKING

from pointkit.errors import InputError

if TYPE_CHECKING:
    from markupsafe import Markup

_SETTINGS = {
    "_disable_config": True,  # a docutils.conf of the working folder changes no caption
    "doctitle_xform": False,
    "file_insertion_enabled": False,
    "raw_enabled": False,
    "report_level": 5,  # faults are exceptions, not paragraphs of the page
    "halt_level": 2,
    "warning_stream": False,
}


def caption_html(text: str, name: str = "a caption") -> Markup:
    """Convert a caption from reStructuredText to HTML paragraphs.

    Text in `single` or ``double`` backquotes is shown as code.

    Parameters
    ----------
    text
        The caption.
    name
        Name of the figure or table, for the error message.

    Raises
    ------
    InputError
        The text is not valid reStructuredText.
    """
    from docutils.core import publish_parts
    from docutils.utils import SystemMessage
    from docutils.writers.html5_polyglot import Writer
    from markupsafe import Markup

    source = f".. default-role:: literal\n\n{text}"
    writer = Writer()
    writer.translator_class = _translator()
    try:
        parts = publish_parts(source, writer=writer, settings_overrides=_SETTINGS)
    except SystemMessage as error:
        reason = str(error).splitlines()[0].partition(") ")[2]
        raise InputError(f"caption of {name}: {reason}") from error
    body = str(parts["body"]).strip()
    return Markup(body.replace("</p>\n<p>", "</p><p>").replace("\n", " "))  # noqa: S704


def _translator() -> type:
    from docutils.nodes import SkipNode, literal
    from docutils.writers.html5_polyglot import HTMLTranslator

    class Plain(HTMLTranslator):  # type: ignore[misc]
        """Writer of code as ``<code>`` without CSS classes, for which the page has no style."""

        def visit_literal(self, node: literal) -> None:
            self.body.append(f"<code>{self.encode(node.astext())}</code>")
            raise SkipNode

    return Plain
