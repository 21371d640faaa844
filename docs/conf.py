"""Sphinx's configuration of the documentation site: ``make docs``."""

from __future__ import annotations

import sys
from importlib.metadata import version as installed_version
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "extensions"))

project = "o3d_sofnn"
copyright = "o3d_sofnn contributors, MIT licence"
version = release = installed_version("o3d_sofnn")

extensions = [
    "myst_nb",
    "numpydoc",
    "sphinx.ext.autodoc",
    # Of this folder:
    "command_reference",
    "mathml",
    "repository_links",
]
exclude_patterns = ["_build", "packaging/conda-forge"]
root_doc = "index"
smartquotes = False  # two hyphens are an option

html_theme = "furo"
html_title = "o3d_sofnn"
html_copy_source = False
html_static_path = ["static"]
html_css_files = ["site.css"]
html_math_renderer = "mathml"

myst_enable_extensions = ["dollarmath", "amsmath", "deflist"]
myst_heading_anchors = 3

nb_execution_mode = "auto"
nb_execution_in_temp = True
nb_execution_timeout = 120
nb_execution_raise_on_error = True
nb_merge_streams = True

autodoc_typehints = "none"  # the docstrings say types, with shapes
autodoc_member_order = "bysource"
numpydoc_show_class_members = False
numpydoc_class_members_toctree = False
autodoc_mock_imports = ["pymeshlab"]  # meshlab_sofnn is described without it

# numpydoc links the attributes that estimators have after `fit`, which are described in place.
nitpick_ignore_regex = [("py:obj", r"\w+_")]
