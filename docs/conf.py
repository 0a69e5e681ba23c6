"""Settings of the documentation site: ``make docs`` builds it with Sphinx and checks it."""

from __future__ import annotations

import shutil
import sys
import tomllib
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "extensions"))

project = "bumpstop"
author = "the bumpstop authors"
copyright = author  # noqa: A001
with (HERE.parent / "pyproject.toml").open("rb") as _file:
    version = release = tomllib.load(_file)["project"]["version"]

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "myst_nb",
    "mathml",
    "reference_pages",
    "made_pictures",
    "comparisons",
    "collision_page",
]
# The headers are documented where Doxygen is installed; the site says so where it is not.
doxygen = shutil.which("doxygen")
if doxygen:
    extensions.append("breathe")
    breathe_default_project = "bumpstop"
    breathe_projects = {"bumpstop": str(HERE.parent / "build" / "doxygen" / "xml")}
    breathe_default_members = ("members",)

exclude_patterns = ["extensions", "images"]
html_theme = "furo"
html_title = f"bumpstop {version}"
html_static_path = ["extensions/site.css"]
html_css_files = ["site.css"]
html_show_sphinx = False
html_copy_source = False
html_theme_options = {
    "footer_icons": [],
    "announcement": "Not a certified safety function",
}
pygments_style = "friendly"

myst_enable_extensions = ["dollarmath", "deflist"]
myst_heading_anchors = 4
myst_number_code_blocks: list[str] = []
suppress_warnings = ["myst.header"]
# Formulas are MathML, which browsers draw themselves: no script, no fonts.
html_math_renderer = "mathml"

nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 300
nb_merge_streams = True

autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autosummary_generate = False
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
napoleon_attr_annotations = False

nitpicky = True
# Types in signatures are those of numpy, polars and the standard library, whose pages are not here.
nitpick_ignore_regex = [(r"py:.*", r".*"), (r"cpp:.*", r".*")]
