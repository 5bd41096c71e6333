"""Settings of the documentation site: ``python scripts/docs.py`` builds and checks it."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path
from typing import Any

from sphinx.util.nodes import make_refnode

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "src"))

import graspcast  # noqa: E402

project = "graspcast"
author = "the authors of graspcast"
project_copyright = "the authors of graspcast, Apache-2.0"
release = version = graspcast.__version__

# The notebook is a page of the site; its pictures are committed, CI runs it again.
shutil.copyfile(HERE.parent / "notebooks" / "tour.ipynb", HERE / "tour.ipynb")

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "sphinx.ext.napoleon"]
exclude_patterns = ["_build"]
templates_path = ["_templates"]

myst_heading_anchors = 4
myst_enable_extensions = ["colon_fence", "deflist"]
nb_execution_mode = "off"

autosummary_generate = True
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # numpydoc docstrings state types and shapes
autodoc_default_options = {"members": True, "undoc-members": False}
napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False

# What a strict build (-n) does not ask for: types of other packages, as their documentation is on
# other hosts, and what docstrings name of modules that have no page because they are not public.
nitpick_ignore_regex = [
    ("py:class", r"(?!graspcast\.[A-Z]).*"),
    ("py:obj", r"graspcast\.InstanceKey\.(index|count)"),  # a tuple's own
    (r"py:(func|meth|mod|data|attr|obj)", r"(?!graspcast\.[A-Z]).*"),
]

html_theme = "furo"
html_title = "graspcast"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sphinx = False
pygments_style = "default"
pygments_dark_style = "github-dark"


def resolve(app: Any, env: Any, node: Any, content: Any) -> Any:
    """Link public names and errors, which docstrings call by the modules where they are defined."""
    if node.get("refdomain") != "py":
        return None
    first, _, member = node["reftarget"].removeprefix("~").rpartition(".")
    for name in (member, f"{first.rpartition('.')[2]}.{member}"):
        for full in (f"graspcast.{name}", f"graspcast.errors.{name}"):
            found = env.domains["py"].objects.get(full)
            if found is not None:
                page, anchor = found.docname, found.node_id
                here, page, anchor = node["refdoc"], found.docname, found.node_id
                return make_refnode(app.builder, here, page, anchor, content, full)
    return None


def setup(app: Any) -> None:
    """Add what Sphinx calls on building."""
    app.connect("missing-reference", resolve)
