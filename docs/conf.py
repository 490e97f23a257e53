"""The documentation site: `make docs` builds it into site/, with warnings as errors."""

import logging
import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))  # for _parts

# First: sets the cache directory of compiled code, which JAX reads when it is imported.
import exosight.app  # noqa: E402, F401
from exosight import __version__  # noqa: E402

for name in ("jax", "onnx_ir", "onnxscript"):  # verbose
    logging.getLogger(name).setLevel(logging.WARNING)

project, author, release, version = "exosight", "The exosight developers", __version__, __version__
copyright = "the exosight developers, MIT licence"
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx_gallery.gen_gallery",
    "_parts.docstrings",
    "_parts.mathml",
    "_parts.reference",
]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
exclude_patterns = ["tutorials", "results", "**/README.rst"]

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_preserve_defaults = True
maximum_signature_line_length = 90
add_module_names = False
toc_object_entries = False  # the navigation lists pages and modules; thousands of names make it slow

sphinx_gallery_conf = {
    "examples_dirs": "tutorials",
    "gallery_dirs": "tutorials_run",
    "filename_pattern": r"/\d\d_",
    "within_subsection_order": "FileNameSortKey",
    "image_scrapers": ("_parts.pictures.scraper",),
    "abort_on_example_error": True,
    "capture_repr": (),
    "download_all_examples": False,
    "write_computation_times": False,
    "show_signature": False,
}

html_theme = "furo"
html_title = f"exosight {__version__}"
html_math_renderer = "mathml"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sphinx = False
html_theme_options = {
    "light_css_variables": {"color-brand-primary": "#0072B2", "color-brand-content": "#0072B2"},
    "dark_css_variables": {"color-brand-primary": "#56B4E9", "color-brand-content": "#56B4E9"},
}
