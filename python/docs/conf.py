"""Settings of Sphinx; `./run docs` builds the pages into build/docs/html."""

import sys
from pathlib import Path

import sheetsplat

sys.path.insert(0, str(Path(__file__).parent / "_tools"))

project = "sheetsplat"
author = "The sheetsplat authors"
version = release = sheetsplat.__version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "pages",
]
exclude_patterns = ["_tools", "_templates", "**.ipynb_checkpoints"]
templates_path = ["_templates"]
nitpicky = False
# In docstrings `name` is a name of the package where there is one, else code.
default_role = "code"

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4
# Notebooks hold no results; they are run when the pages are built.
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 120
suppress_warnings = ["config.cache"]

autosummary_generate = True
autosummary_ignore_module_all = False
autodoc_typehints = "none"
autodoc_member_order = "bysource"
napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False
autodoc_default_options = {"members": True, "show-inheritance": True}

html_theme = "pydata_sphinx_theme"
html_title = "sheetsplat"
html_show_sourcelink = False
html_static_path = ["_static"]
html_css_files = ["pages.css"]
# Only these pages have others below them, which the sidebar would list.
_PARENTS = ("api", "notebooks")
html_sidebars = {page.stem: [] for page in Path(__file__).parent.glob("*.md") if page.stem not in _PARENTS}
html_theme_options = {"navigation_with_keys": False, "secondary_sidebar_items": ["page-toc"]}
