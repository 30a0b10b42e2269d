"""The documentation builds without a single warning: links, references, formulas, docstrings."""

from __future__ import annotations

import importlib
import re
import subprocess
import sys
from pathlib import Path

import pytest
from documented_code import DOCS

BUILD = """
import logging, sys
from sphinx.cmd.build import main
from sphinx.ext.autodoc._dynamic import _loader
from sphinx.pycode.parser import Parser
logging.disable(logging.DEBUG)
Parser.parse_definition = lambda _: None  # looks for lines of the source to link to, which no page does
signatures = _loader._format_signatures  # of what can be called they come from the code, and hold no links
_loader._format_signatures = lambda props, **given: (
    [('()', '')]
    if props.obj_type in ('class', 'exception', 'function', 'method')
    else signatures(props=props, **given)
)
sys.exit(main(sys.argv[1:]))
"""
"""Sphinx without what takes a quarter of its time and finds no mistake."""


def test_site_builds_without_warnings(tmp_path: Path) -> None:
    pytest.importorskip("sphinx", reason="needs the extra 'docs'")
    quickly = ("-q", "-b", "dummy", "-D", "smartquotes=0")
    built = subprocess.run(
        [sys.executable, "-c", BUILD, *quickly, "-W", "--keep-going", str(DOCS), str(tmp_path)],
        check=False,
        capture_output=True,
        text=True,
    )
    assert built.returncode == 0, built.stderr


def test_what_stands_before_a_colon_is_not_taken_for_a_type(monkeypatch: pytest.MonkeyPatch) -> None:
    napoleon = pytest.importorskip("sphinx.ext.napoleon", reason="needs the extra 'docs'")
    monkeypatch.syspath_prepend(DOCS / "_extensions")
    text = ["Longest side in pixels: 19 000 places."]
    importlib.import_module("package_modules")._keep_whole(None, "attribute", "", None, None, text)
    made = napoleon.NumpyDocstring(text, napoleon.Config(), what="attribute", name="SIDE").lines()
    assert made[-1] == "Longest side in pixels: 19 000 places."


FORMULA = re.compile(r"\$\$(.+?)\$\$|\$([^$\n]+?)\$", re.DOTALL)


@pytest.mark.parametrize("page", sorted(p for p in DOCS.rglob("*.md") if "$" in p.read_text()), ids=lambda p: p.name)
def test_formulas_show_without_a_network(page: Path) -> None:
    latex2mathml = pytest.importorskip("docutils.utils.math.latex2mathml", reason="needs the extra 'docs'")
    text = re.sub(r"```.*?```|`[^`]*`", "", page.read_text(), flags=re.DOTALL)
    for block, inline in FORMULA.findall(text):
        assert latex2mathml.tex2mathml(block or inline, as_block=bool(block)).startswith("<math")
        # It takes the digits of \frac12 for one number, and the next term for the denominator.
        assert not re.search(r"frac\d|underbrace", block or inline)
