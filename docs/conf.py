"""Sphinx' configuration of the site: `sphinx-build -W -b html docs out/site`.

The chapters are the pages of the repository: a file here that includes one of them has no text of
its own. `extensions/` beside this file turns their links into links of the site, and generates the
list of commands, the gallery, and a page for each public name in `api/names`, which git ignores.
`lecture` beside this file is a link to the lecture's folder, whose pages are notebooks; the build
runs them.
"""

import sys
import tomllib
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent), str(HERE / "extensions")]
_project = tomllib.loads((HERE.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]

project, version = _project["name"], _project["version"]
release = version
extensions = [
    *("myst_nb", "sphinx.ext.autodoc", "sphinx.ext.viewcode", "numpydoc"),
    *("sphinx_copybutton", "sphinx_design"),
    *("chapters", "commands", "gallery", "mathml", "notebooks"),
    *("public_names", "section_index"),
]
exclude_patterns = ["_templates", "conf.py", "extensions", "lecture/__*", "lecture/README.md"]
# read by `chapters`: the address of files that are not in the site
repository = _project["urls"]["Repository"]

templates_path, html_static_path = ["_templates"], ["_static"]
html_theme, html_title = "pydata_sphinx_theme", f"fecloth {version}"
html_theme_options = {
    "navbar_start": ["navbar-logo", "version.html"],
    "navbar_align": "left",
    "navbar_persistent": ["search-button-field"],
    "navbar_end": ["theme-switcher"],
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": [],
    "footer_end": [],
    "show_prev_next": True,
    "search_bar_text": "search",
    "logo": {"text": "fecloth"},
    "header_links_before_dropdown": 7,
    "navigation_with_keys": False,
}
html_sidebars = {name: [] for name in ("index", "first_steps", "gallery")}
html_css_files = ["site.css"]
html_copy_source = html_show_sourcelink = html_show_copyright = html_show_sphinx = False
html_use_index = False  # the search finds names, too
html_additional_pages = {"search": "search.html"}  # in place of Sphinx' own, see section_index

nb_custom_formats = {".py": ["jupytext.reads", {"fmt": "py:percent"}]}
nb_execution_in_temp, nb_execution_raise_on_error, nb_execution_timeout = True, True, 300
html_math_renderer = "mathml"
myst_enable_extensions = ["colon_fence", "dollarmath"]
myst_heading_anchors = 4  # as on the repository's own pages
default_role = "py:obj"  # `System` in a docstring leads to it
highlight_language = "text"
toc_object_entries_show_parents = "hide"
add_module_names = False
python_maximum_signature_line_length = 88
autodoc_member_order = "bysource"
autodoc_typehints_format, autodoc_preserve_defaults = "short", True
numpydoc_show_class_members = False  # autodoc lists them
