"""The site's Sphinx extensions: docstrings with colons, and formulas that work offline."""

from __future__ import annotations

import importlib
import re
from pathlib import Path

import pytest
from documented_code import DOCS


def test_text_before_a_colon_is_not_treated_as_a_type(monkeypatch: pytest.MonkeyPatch) -> None:
    napoleon = pytest.importorskip("sphinx.ext.napoleon", reason="needs the extra 'docs'")
    monkeypatch.syspath_prepend(DOCS / "_extensions")
    text = ["Longest side in pixels: 19 000 places."]
    importlib.import_module("package_modules")._keep_whole(None, "attribute", "", None, None, text)
    made = napoleon.NumpyDocstring(text, napoleon.Config(), what="attribute", name="SIDE").lines()
    assert made[-1] == "Longest side in pixels: 19 000 places."


TABLE = re.compile(r"(?:^\|.*\n)+", re.MULTILINE)


@pytest.mark.parametrize(
    "page", sorted(p for p in DOCS.rglob("*.md") if "\n|" in p.read_text()), ids=lambda p: p.name
)
def test_every_row_of_a_table_has_the_cells_of_the_first(page: Path) -> None:
    """Markdown shows other tables as text."""
    for table in TABLE.findall(page.read_text()):
        rows = [len(re.findall(r"(?<!\\)\|", row)) for row in table.splitlines()]
        assert rows == [rows[0]] * len(rows), table.splitlines()[0]


FORMULA = re.compile(r"\$\$(.+?)\$\$|\$([^$\n]+?)\$", re.DOTALL)


@pytest.mark.parametrize("page", sorted(p for p in DOCS.rglob("*.md") if "$" in p.read_text()), ids=lambda p: p.name)
def test_formulas_are_shown_offline(page: Path) -> None:
    latex2mathml = pytest.importorskip("docutils.utils.math.latex2mathml", reason="needs the extra 'docs'")
    text = re.sub(r"```.*?```|`[^`]*`", "", page.read_text(), flags=re.DOTALL)
    for block, inline in FORMULA.findall(text):
        assert latex2mathml.tex2mathml(block or inline, as_block=bool(block)).startswith("<math")
        # latex2mathml parses the digits of \frac12 as one number and takes the next term as the denominator.
        assert not re.search(r"frac\d|underbrace", block or inline)
