"""Builds the documentation by `sphinx-build -W docs docs/_build/html`, with `vffnull[docs]` installed.

Needs no network, neither to build nor to read. Tutorials are executed, examples too, and the pages under
`generated/` are made from what the installed package says of itself.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

import vffnull

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "_ext"))
os.environ.setdefault("PYDEVD_DISABLE_FILE_VALIDATION", "1")  # kernels would warn of frozen modules
os.environ.pop("MPLBACKEND", None)  # kernels show figures where they are
(HERE / "generated" / "written").mkdir(parents=True, exist_ok=True)

project = "vffnull"
release = version = vffnull.__version__
copyright = "the vffnull authors, MIT licence"
extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.mathjax",
    "numpydoc",
    "myst_nb",
    "sphinx_design",
    "sphinx_copybutton",
    "sphinx_gallery.gen_gallery",
    "equations",
    "pages",
    "snippets",
    "stubs",
]
exclude_patterns = ["_build", "generated/figures", "generated/written", "gallery/*.ipynb", "gallery/*.py"]
suppress_warnings = ["config.cache"]  # the gallery's settings are objects; nothing is lost
default_role = "py:obj"
highlight_language = "none"
smartquotes = False
add_module_names = False
toc_object_entries_show_parents = "hide"

html_theme = "pydata_sphinx_theme"
html_title = "vffnull"
html_static_path = ["_static"]
html_extra_path = ["generated/written"]  # what examples write beside pictures
html_css_files = ["custom.css"]
html_favicon = "_static/logo.svg"
html_show_sourcelink = False
html_copy_source = False
html_sidebars = {name: [] for name in ("index", "start", "theory", "generated/scenarios", "speed")}
html_theme_options = {
    "logo": {"text": "vffnull", "image_light": "_static/logo.svg", "image_dark": "_static/logo.svg"},
    "navbar_align": "left",
    "navbar_end": ["theme-switcher"],
    "header_links_before_dropdown": 8,
    "show_toc_level": 2,
    "show_nav_level": 1,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "pygments_light_style": "tango",
    "pygments_dark_style": "github-dark",
}
mathjax_path = "tex-svg.js"
mathjax3_config = {
    "options": {"enableMenu": False, "processHtmlClass": "math", "ignoreHtmlClass": "body"},
    "svg": {"fontCache": "global", "scale": 0.9},
}

autodoc_typehints = "none"
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True}
numpydoc_show_class_members = False

myst_enable_extensions = ["dollarmath", "colon_fence", "deflist"]
myst_heading_anchors = 3
myst_update_mathjax = False
myst_links_external_new_tab = False
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 120
nb_merge_streams = True

sphinx_gallery_conf = {
    "examples_dirs": "../examples",
    "gallery_dirs": "gallery",
    "filename_pattern": ".*",
    "image_scrapers": ("pages.written_files",),
    "reset_modules": ("matplotlib", "pages.warnings_as_errors"),
    "reset_modules_order": "both",
    "within_subsection_order": "pages.Order",
    "thumbnail_size": (480, 300),
    "abort_on_example_error": True,
    "download_all_examples": False,
    "show_memory": False,
    "show_signature": False,
    "min_reported_time": 1e9,
    "capture_repr": (),
    "copyfile_regex": r"",
    "write_computation_times": False,
}
