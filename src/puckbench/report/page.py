"""Rendering of the report's page from templates, data, style and scripts.

The interactive plot uses no library: the smallest in a Python package has 4.8 MB and needs a weaker
content security policy.
"""

from __future__ import annotations

import hashlib
from base64 import b64encode
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup

STYLE = "page.css"
SCRIPTS = (
    *("dom.js", "tables.js", "axes.js", "markers.js", "plot.js"),
    *("camera.js", "drawing.js", "viewer.js", "page.js"),
)
TEMPLATES = ("page.html", "table.html")


def rendered(template: str, **values: Any) -> str:
    """Return the text of a template with values filled in, which are escaped unless markup."""
    return _environment().get_template(template).render(values)


def filled(template: str, **values: Any) -> Markup:
    """Fill values into a template given as text, and return HTML.

    Parameters
    ----------
    template
        Text of a Jinja template.
    values
        Values by name, which are escaped.
    """
    from markupsafe import Markup

    return Markup(_environment().from_string(template).render(values))  # noqa: S704 (escaped)


def whole_page(**values: Any) -> str:
    """Return the HTML of the page; its content security policy forbids foreign content."""
    scripts = [_asset(name) for name in SCRIPTS]
    allowed = " ".join(f"'{_script_hash(text)}'" for text in scripts)
    policy = f"default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src {allowed}"
    return rendered("page.html", policy=policy, css=_asset(STYLE), scripts=scripts, **values)


def assets_version() -> str:
    """Return a digest of templates, style and scripts. If it changes, the page is built again."""
    text = "".join(_asset(name) for name in (*TEMPLATES, STYLE, *SCRIPTS))
    return hashlib.sha256(text.encode()).hexdigest()[:16]


@cache
def _environment() -> Environment:
    from jinja2 import Environment, FunctionLoader, StrictUndefined

    environment = Environment(
        loader=FunctionLoader(_asset),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    compact = {"separators": (",", ":"), "allow_nan": False}
    environment.policies["json.dumps_kwargs"] = compact
    return environment


def _asset(name: str) -> str:
    return files("puckbench.report").joinpath("assets", name).read_text(encoding="utf-8")


def _script_hash(text: str) -> str:
    return "sha256-" + b64encode(hashlib.sha256(text.encode()).digest()).decode("ascii")
