"""The directive ``package-modules``: a section for every module of a package, made from the docstrings in it."""

from __future__ import annotations

import pkgutil
from importlib import import_module
from typing import Any

from docutils import nodes
from docutils.parsers.rst import Directive
from docutils.statemachine import StringList
from sphinx.application import Sphinx


class PackageModules(Directive):
    """Documents the named modules, and all modules of the named packages and their subpackages."""

    required_arguments = 1
    optional_arguments = 20

    def run(self) -> list[nodes.Node]:
        """Return the sections."""
        return [self._section(name) for package in self.arguments for name in _modules(package)]

    def _section(self, name: str) -> nodes.section:
        section = nodes.section(ids=[nodes.make_id(f"module {name}")], names=[f"module {name}"])
        section += nodes.title(text=name)
        text = f"```{{eval-rst}}\n.. automodule:: {name}\n   :members:\n   :show-inheritance:\n```"
        self.state.nested_parse(StringList(text.splitlines(), name), self.content_offset, section)
        return section


def _modules(name: str) -> list[str]:
    """Return the modules of a package, in order, or the name of a module that is not a package."""
    package = import_module(name)
    if not hasattr(package, "__path__"):
        return [name]
    found = pkgutil.walk_packages(package.__path__, f"{name}.")
    return sorted(module.name for module in found if not module.ispkg)


def _escape_bars(_app: Sphinx, _what: str, _name: str, _obj: object, _options: object, lines: list[str]) -> None:
    """Escape the bars of absolute values, which reStructuredText would take for substitutions."""
    lines[:] = [line if "``" in line else line.replace("|", "\\|") for line in lines]


def _keep_whole(_app: Sphinx, what: str, _name: str, _obj: object, _options: object, lines: list[str]) -> None:
    """Begin the docstrings of values with an empty comment: or Napoleon takes text before a colon for a type."""
    if what in {"attribute", "data", "property"}:
        lines[:0] = ["..", ""]


def _skip_field(_app: Sphinx, _what: str, _name: str, member: object, *_: object) -> bool | None:
    """Skip the fields of named tuples: the docstrings of their classes have them."""
    return True if type(member).__name__ == "_tuplegetter" else None


def setup(app: Sphinx) -> dict[str, Any]:
    """Add the directive."""
    app.setup_extension("sphinx.ext.autodoc")
    app.add_directive("package-modules", PackageModules)
    app.connect("autodoc-process-docstring", _keep_whole, priority=400)
    app.connect("autodoc-process-docstring", _escape_bars)
    app.connect("autodoc-skip-member", _skip_field)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
