"""How the documentation is built: ``make docs``."""

from __future__ import annotations

import gc
import sys
from pathlib import Path

from sphinx.application import Sphinx

import ospc

sys.path.insert(0, str(Path(__file__).parent / "_extensions"))

# Nearly everything stays until the build ends: to look for garbage takes a quarter of its time and frees little.
gc.disable()

project = "ospc"
author = "The ospc developers"
release = version = ospc.__version__

extensions = [
    "command_help",
    "mathml",
    "myst_parser",
    "package_modules",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
]
exclude_patterns = ["_build"]
nitpicky = True

html_math_renderer = "mathml"
html_theme = "furo"
html_title = f"ospc {release}"
html_show_copyright = False

myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3

napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_use_ivar = False
autodoc_member_order = "bysource"
autodoc_typehints = "none"
autodoc_use_type_comments = False  # there are none, and looking for them parses every module again
python_use_unqualified_type_names = True

# Types of other libraries, and the aliases and private classes of this one, have no pages to be linked to.
nitpick_ignore_regex = [
    ("py:class", r"(?!ospc\.).*"),
    ("py:(class|obj|exc|data|meth|func|attr)", r"(numpy|np|npt|scipy|cv2|click|pathlib|collections|typing)\..*"),
    ("py:class", r"ospc\.arrays\..*"),
    ("py:(class|obj)", r"ospc\.state\.run\.Run"),  # a type variable
    # What is not part of an interface may be named without its module.
    ("py:(data|func|meth|mod|attr|obj)", r"(?!ospc\.).*"),
]


def _drop_empty_globs(app: Sphinx, _page: str, content: list[str]) -> None:
    """Leave out entries of tables of contents that stand for pages which are not there."""
    lines = content[0].splitlines(keepends=True)
    entries = (line.strip() for line in lines)
    kept = [
        line
        for line, entry in zip(lines, entries, strict=True)
        if " " in entry or not entry.endswith("*") or any(Path(app.srcdir).glob(f"{entry}.md"))
    ]
    content[0] = "".join(kept)


def setup(app: Sphinx) -> None:
    """Connect what is defined here."""
    app.connect("source-read", _drop_empty_globs)
