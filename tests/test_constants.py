"""Every numeric constant of the science is explained where it stands."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import ospc

ROOT = Path(ospc.__file__).parent
FOLDERS = ("estimation", "photometry", "simulation", "evaluation", "settings")
MODULES = sorted(path for folder in FOLDERS for path in (ROOT / folder).glob("*.py"))


def holds_a_number(value):
    """Tell whether an expression holds a number, alone or in a tuple, list, dictionary, array or sum."""
    if isinstance(value, ast.Lambda):
        return False
    return any(
        isinstance(node, ast.Constant) and isinstance(node.value, int | float) and not isinstance(node.value, bool)
        for node in ast.walk(value)
    )


def unexplained(source):
    """Return the names of module-level numeric constants with neither a docstring after nor a comment at them.

    A docstring explains all assignments right before it.
    """
    body, lines = ast.parse(source).body, source.splitlines()
    missing, waiting = [], []
    for node in [*body, None]:
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            waiting = []
            continue
        if not isinstance(node, ast.Assign | ast.AnnAssign):
            missing += waiting
            waiting = []
            continue
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        names = [n.id for target in targets for n in ast.walk(target) if isinstance(n, ast.Name)]
        above = lines[node.lineno - 2].strip() if node.lineno > 1 else ""
        commented = above.startswith("#") or "#" in lines[node.end_lineno - 1].rpartition(")")[2]
        if waiting and not above:
            missing += waiting
            waiting = []
        if node.value is not None and holds_a_number(node.value) and not commented:
            waiting += names
    return missing


@pytest.mark.parametrize("path", MODULES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_every_numeric_constant_is_explained(path):
    assert unexplained(path.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize(
    ("source", "names"),
    [
        ("A = 3", ["A"]),
        ("A = 3\n'''Metres.'''", []),
        ("# Metres.\nA = 3", []),
        ("A = 3  # metres", []),
        ("A, B = 3, 4\ndef f(): pass", ["A", "B"]),
        ("A = 3\nB = -4\n'''Both.'''", []),
        ("A = 3\n\nB = 4\n'''Only this one.'''", ["A"]),
        ("A: float = 3 / 255", ["A"]),
        ("A = np.array([1.0, 2.0])", ["A"]),
        ("A = 'text'\nB = other(A)", []),
    ],
)
def test_what_counts_as_an_explanation(source, names):
    assert unexplained(source) == names
