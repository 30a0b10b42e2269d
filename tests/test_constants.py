"""A docstring explains every numeric constant, and the numbers of the method are settings."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import ospc

ROOT = Path(ospc.__file__).parent
NOT_CHECKED = {"cli", "report", "research"}
MODULES = sorted(path for path in ROOT.rglob("*.py") if path.relative_to(ROOT).parts[0] not in NOT_CHECKED)

WITH_SETTINGS = (
    *("correspondence", "diagnosis", "estimation", "evaluation", "exposures", "live", "methods", "observations.py"),
    *("pooling", "unknown_exposures"),
)
"""Packages and modules whose numbers are settings."""

CHECKED = [path for path in MODULES if path.relative_to(ROOT).parts[0] in WITH_SETTINGS]

STAY_IN_THE_CODE = {
    # Parts of formulas: stencils, nodes, powers, directions, and sizes and indices that follow from settings.
    "NODES", "CENTRE", "_TAPS", "_EVEN", "(_SLOPE, _CURVATURE)", "_SUMS", "_LAPLACIANS", "_NEIGHBOURS", "_CORNERS",
    "_VIGNETTE_POWERS", "RESPONSE_PARAMETERS", "PARTS", "_LATER", "_NORMAL", "MOMENTS", "SURROUND_MOMENTS", "_WIDTHS",
    "_RADIAL", "(_RIGHT, _DOWN)", "_DIAGONAL", "_TURNS", "_PLACES", "RESPONSE_PART", "SHAPES",
    # Effects, which are defined by settings; their bound of 0 excludes negative light.
    "EFFECTS",
    # Points at which curves are tabulated or drawn, and a displacement larger than any image.
    "RESPONSE_LEVELS", "_STEPS", "OUTSIDE_PX", "_CURVE_POINTS", "_LEVELS",
    # An empty value, and buffer sizes.
    "NOTHING_FOUND", "_MAX_COUNTED_BITS", "_MOST_PARTS", "_FIRST_CAPACITY", "_BLOCK", "_KEPT_TABLES",
    "WAITING_FRAMES", "QUEUE_BYTES",
    # What files contain: versions, and limits beyond which their values are damaged.
    "(KIND, VERSION)", "_LARGEST_FILE", "_COLUMNS", "_QUATERNION_LENGTHS", "_ROUNDING", "_MOST_DROPPED",
    "(_MOST, _LONGEST_MS, _FARTHEST, _LARGEST)",
    # Instructions, reports, and the page of a live calibration.
    "_BRIGHTER", "_DARKER", "_MOST_NAMED", "_MOST_LISTED", "MOST_NOTES", "(_COLUMNS, _ROWS)", "(_GREYS, _RADII)",
    "(_PICTURE_PX, _JPEG)", "(_WIDE_RANGE, _NOTHING_KNOWN, _UNCONFIRMED)", "_COVERED", "_LAST_WORD_S", "_PERIOD_S",
    "_TOKEN_BYTES", "(ADVICE_S, ADVICE_SHARE)",
}  # fmt: skip

MOST_TOGETHER = 3
"""Maximum number of assignments that one docstring can explain."""


def holds_a_number(value):
    """Return whether an expression contains a number, alone or in a tuple, list, dictionary, array or sum."""
    if isinstance(value, ast.Lambda):
        return False
    return any(
        isinstance(node, ast.Constant) and isinstance(node.value, int | float) and not isinstance(node.value, bool)
        for node in ast.walk(value)
    )


def unexplained(source):
    """Return the names of module-level numeric constants without a docstring below them.

    A docstring explains up to three assignments directly above it.
    """
    missing, waiting, end = [], [], 0
    for node in ast.parse(source).body:
        is_docstring = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        if node.lineno > end + 1 or not (is_docstring or isinstance(node, ast.Assign | ast.AnnAssign)):
            missing += waiting
            waiting = []
        end = node.end_lineno
        if is_docstring:
            missing += waiting[:-MOST_TOGETHER]
            waiting = []
        elif isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None and holds_a_number(node.value):
            waiting.append(ast.unparse(node.targets[0] if isinstance(node, ast.Assign) else node.target))
    return missing + waiting


def numbers(source):
    """Return the names of module-level constants that contain a number."""
    assigned = [node for node in ast.parse(source).body if isinstance(node, ast.Assign | ast.AnnAssign)]
    return [
        ast.unparse(node.targets[0] if isinstance(node, ast.Assign) else node.target)
        for node in assigned
        if node.value is not None and holds_a_number(node.value)
    ]


def single(group):
    """Return the names in the target of an assignment, which may be a tuple."""
    return [node.id for node in ast.walk(ast.parse(group, mode="eval")) if isinstance(node, ast.Name)]


def found(names_in, paths):
    """Return the names that a function finds in modules, for each module with any."""
    names = {path.relative_to(ROOT).as_posix(): names_in(path.read_text(encoding="utf-8")) for path in paths}
    return {module: some for module, some in names.items() if some}


def repeated(source):
    """Return the names of module-level constants that are assigned more than once."""
    names = [name for group in numbers(source) for name in single(group)]
    return {name for name in names if names.count(name) > 1}


def test_numbers_of_the_method_are_settings():
    assert found(lambda source: set(numbers(source)) - STAY_IN_THE_CODE, CHECKED) == {}


def test_every_setting_has_a_name_of_its_own():
    paths = (ROOT / "settings").glob("*.py")
    names = [name for path in paths for group in numbers(path.read_text(encoding="utf-8")) for name in single(group)]
    assert len(names) == len(set(names))


def test_every_number_is_explained():
    assert found(unexplained, MODULES) == {}


def test_no_number_replaces_another_of_the_same_name():
    assert found(repeated, MODULES) == {}


@pytest.mark.parametrize(
    ("source", "names"),
    [
        ("A = 3", ["A"]),
        ("A = 3\n'''Metres.'''", []),
        ("# Metres.\nA = 3", ["A"]),
        ("A = 3  # metres", ["A"]),
        ("A = 3\n\n'''Too far away.'''", ["A"]),
        ("A, B = 3, 4\ndef f(): pass", ["(A, B)"]),
        ("A = 3\nB = 4\nC = 5\nD = 6\n'''Four at once.'''", ["A"]),
        ("A = 3\nB = -4\n'''Both.'''", []),
        ("A = 3\n\nB = 4\n'''Only this one.'''", ["A"]),
        ("A: float = 3 / 255", ["A"]),
        ("A = np.array([1.0, 2.0])", ["A"]),
        ("A = 'text'\nB = other(A)", []),
    ],
)
def test_what_counts_as_an_explanation(source, names):
    assert unexplained(source) == names
