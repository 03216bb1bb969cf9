"""Sphinx settings. `make docs` builds the site in docs/_build; every example on it is run."""

import logging
import os
import sys
import tempfile
from importlib.metadata import version as version_of
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

# Commands on the pages are those of this environment, on one core each, in a text of fixed width.
os.environ["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "COLUMNS": "88"}
os.environ.setdefault("MPLCONFIGDIR", tempfile.mkdtemp())
os.environ["IPYTHONDIR"] = tempfile.mkdtemp()
_kernel = Path(os.environ["IPYTHONDIR"]) / "profile_default" / "ipython_kernel_config.py"
_kernel.parent.mkdir()
_kernel.write_text("get_config().IPKernelApp.log_level = 40\n")  # errors only

logging.getLogger("traitlets").setLevel(logging.WARNING)  # of nbclient

project = "trunk_ocp"
author = "the trunk_ocp developers"
version = release = version_of("trunk_ocp")
html_title = f"trunk_ocp {release}"

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.mathjax",
    "sphinx.ext.napoleon",
    "live_examples",
    "from_code",
]
exclude_patterns = ["_build", "_ext", "figures"]
smartquotes = False  # they would make one dash of the two of an option
html_theme = "furo"
templates_path: list[str] = []

myst_enable_extensions = ["amsmath", "dollarmath", "deflist"]
myst_heading_anchors = 3

# Examples: an error in one of them is an error of the build.
nb_execution_mode = "force"
nb_execution_in_temp = True
nb_execution_raise_on_error = True
nb_execution_timeout = 300
nb_merge_streams = True

# Docstrings: numpy style; single backticks are code.
default_role = "literal"
napoleon_numpy_docstring = True
napoleon_google_docstring = False
napoleon_use_param = False
napoleon_use_rtype = False
napoleon_use_ivar = True
autodoc_member_order = "bysource"
autodoc_class_signature = "mixed"
nitpicky = True
suppress_warnings = ["config.cache"]
