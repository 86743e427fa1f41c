"""How the documentation is built: Sphinx, MyST and sphinx-gallery, without network at build or view time."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import matplotlib as mpl

import flgpr

mpl.use("Agg")

project = "flgpr"
author = copyright = "the flgpr authors"
version = release = flgpr.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "numpydoc",
    "sphinx_gallery.gen_gallery",
    "mathml",
    "names",
    "commands",
    "links",
]
exclude_patterns = ["_build", "gallery", "examples/*.ipynb", "examples/*.py"]
suppress_warnings = [
    "toc.not_included",
    "ref.python",
]  # short type names of docstrings may fit twice
nitpicky = True  # a reference that leads nowhere is an error
# The step-by-step pages of the papers name the very function or entry of a recipe; not all of them
# have a page of their own. That each exists is tested with the names of all pages.
# Aliases in annotations are printed with the names that they stand for.
nitpick_ignore = [
    ("py:class", "collections.abc.Callable"),
    ("py:class", "collections.abc.Iterator"),
    ("py:class", "collections.abc.Mapping"),
]
nitpick_ignore_regex = [
    ("py:obj", r"flgpr\.(kernels|features|detect|clutter)\.\w+(\.\w+)*"),
    ("py:obj", r"flgpr\.(recipe\.schema|recipe\.tables|method\.classifier|stages)\.\w+(\.\w+)*"),
]
highlight_language = "none"  # a fence without a language is for the shell, or a drawing

smartquotes_action = "qe"  # options of commands keep their two hyphens
html_theme = "furo"
html_title = f"flgpr {version}"
html_static_path = ["_static"]
html_css_files = ["extra.css"]
html_math_renderer = "mathml"
html_copy_source = False
html_show_sourcelink = False
templates_path = ["_templates"]

myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_heading_anchors = 3

autodoc_typehints = "none"
autodoc_default_options = {"members": True}
numpydoc_show_class_members = False
numpydoc_class_members_toctree = False

sphinx_gallery_conf = {
    "examples_dirs": "gallery",
    "gallery_dirs": "examples",
    "filename_pattern": r"/plot_",
    "abort_on_example_error": True,
    "download_all_examples": False,
    "remove_config_comments": True,
    "show_memory": False,
    "write_computation_times": False,
    "image_scrapers": ("scrapers", "matplotlib"),
    "matplotlib_animations": False,
    "within_subsection_order": "FileNameSortKey",
    "min_reported_time": 1,
    "default_thumb_file": str(Path(__file__).parent / "images" / "theory-geometry.png"),
    "show_signature": False,
    "ignore_repr_types": r"matplotlib|Figure|Axes|Colorbar",
    "capture_repr": ("_repr_html_", "__repr__"),
}
linkcheck_ignore = [r".*"]

_INHERITED = {
    "model_config",
    "set_fit_request",
    "set_score_request",
    "set_predict_request",
    "set_transform_request",
}


def setup(app):
    """Leave out what scikit-learn and pydantic put into every class."""
    app.connect("autodoc-skip-member", lambda *event: True if event[2] in _INHERITED else None)
