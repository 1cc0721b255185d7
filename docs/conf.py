"""Sphinx's configuration: `make docs` builds the site into site/; no page fetches anything."""

import os
import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "extensions"))

# The kernels of the tutorials find this clone, its package and its commands.
os.environ["PUCKBENCH"] = str(HERE.parent)
os.environ["PYTHONPATH"] = str(HERE.parent / "src")
os.environ["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
sys.path.insert(0, str(HERE.parent / "src"))

project = "puckbench"
author = "the authors of puckbench"
copyright = "the authors of puckbench, BSD-3-Clause"  # noqa: A001 (Sphinx's name)

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "generated_reference",
]
exclude_patterns = ["extensions", "**/README.md"]
default_role = "py:obj"

html_theme = "furo"
html_title = "puckbench"
html_static_path = ["static"]
html_css_files = ["ranking.css"]
html_theme_options = {"navigation_with_keys": True}
html_show_sourcelink = False

myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 3
suppress_warnings = ["myst-nb.lexer"]  # of notebooks that are not executed

# The tests run each tutorial by itself, and build the site with DOCS_EXECUTE=off.
nb_execution_mode = os.environ.get("DOCS_EXECUTE", "force")
nb_execution_in_temp = True
nb_execution_raise_on_error = True
nb_execution_timeout = 1200
nb_merge_streams = True

autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
autodoc_default_options = {"members": True}
napoleon_google_docstring = False
napoleon_use_rtype = False
