"""Break the estimator in known ways, one at a time, and check that the accuracy gate notices.

    python benchmarks/mutations.py
    python benchmarks/mutations.py --only vignette-sign --only no-mean-shift --results mutations

Each mutation changes one function in a copy of ``src/ospc``; the sources themselves are never touched. The gate,
``tests/accuracy``, then runs against the copy. It must pass on the unchanged copy and fail on every mutated one. If
a mutation no longer finds its function, that is an error, not a pass: adapt the mutation to the changed code.
"""

from __future__ import annotations

import argparse
import ast
import os
import re
import shutil
import subprocess
import sys
import tempfile
import textwrap
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from xml.etree import ElementTree

from results import Row, measured, table_of

ROOT = Path(__file__).resolve().parents[1]
GATE = ROOT / "tests" / "accuracy"
CLEAN = "unchanged"


@dataclass(frozen=True)
class Mutation:
    """One way to break the code, named as for ``--only``, and the harm it does.

    ``function`` is the qualified name of the function to change, ``Class.method`` or ``function``, in any module;
    ``change`` maps the dedented source text of its body to the mutated one.
    """

    name: str
    function: str
    change: Callable[[str], str]
    harm: str


def body(text: str) -> Callable[[str], str]:
    return lambda _source: text


def replaced(old: str, new: str) -> Callable[[str], str]:
    """Replace a text that the body must contain."""

    def change(source: str) -> str:
        if old not in source:
            raise LookupError(f"its body doesn't contain '{old}'")
        return source.replace(old, new)

    return change


def exposures_late(source: str) -> str:
    """Delay the exposures in the returned table by one frame."""
    late = """
from dataclasses import replace as with_changes
e = table.exposures_ms
return with_changes(table, exposures_ms=np.concatenate([e[:1], e[:-1]]))
"""
    changed, count = re.subn(r"\breturn (?=[^\n]*\Z)", "table = ", source.strip())
    if not count:
        raise LookupError("its body doesn't end with a return statement")
    return changed + late


MUTATIONS = (
    Mutation("no-mean-shift", "ObservedShifts.increase_by_noise", body("return np.zeros(len(self.index))"),
        "ignores that noise shifts the mean grey level where the response bends or clips"),
    Mutation("linearised-at-measured", "LatentModel.__call__",
        replaced("LATENT_ITERATIONS if self.trusted else 0", "0"),
        "linearises at the noisy grey level measured, which attenuates the fit"),
    Mutation("any-place", "FlatSampler._is_flat", body("return np.ones(len(places), bool)"),
        "samples edges and clipped pixels too"),
    Mutation("nothing-forgotten", "Reservoir.forget_before", body("return None"),
        "keeps the early pairs, which were registered before the vignette was known"),
    Mutation("exposures-late", "read_times", exposures_late, "gives every frame the exposure of the one before it"),
    Mutation("vignette-sign", "VignetteBasis.log_value", replaced("return self.vignette(", "return -self.vignette("),
        "predicts brighter corners where the fit says darker ones"),
    Mutation("vignette-jacobian-sign", "VignetteBasis.jacobian",
        replaced("return np.concatenate(", "return -np.concatenate("),
        "moves the vignette's parameters away from the solution"),
)  # fmt: skip
"""The mutations that the gate has to catch."""


def mutate(sources: Path, mutation: Mutation) -> None:
    """Apply a mutation to a copy of the package.

    Raises
    ------
    LookupError
        If not exactly one function has that name, or its body isn't what the mutation expects.
    """
    begin = f"def {mutation.function.rpartition('.')[2]}("
    modules = [path for path in sorted(sources.rglob("*.py")) if begin in path.read_text(encoding="utf-8")]
    found = [
        (path, node)
        for path in modules
        for name, node in _functions(ast.parse(path.read_text(encoding="utf-8")))
        if name == mutation.function
    ]
    if len(found) != 1:
        raise LookupError(f"{mutation.name}: {len(found)} functions are called {mutation.function}, not 1")
    path, node = found[0]
    lines = path.read_text(encoding="utf-8").splitlines()
    first, last = node.body[0].lineno - 1, node.body[-1].end_lineno or 0
    margin = " " * node.body[0].col_offset
    try:
        changed = mutation.change(textwrap.dedent("\n".join(lines[first:last])))
    except LookupError as error:
        raise LookupError(f"{mutation.name}: {mutation.function} has changed: {error}") from None
    lines[first:last] = textwrap.indent(changed, margin).splitlines()
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _functions(module: ast.Module) -> list[tuple[str, ast.FunctionDef]]:
    """Return the functions of a module and the methods of its classes with their qualified names."""
    functions = [(node.name, node) for node in module.body if isinstance(node, ast.FunctionDef)]
    for owner in module.body:
        if isinstance(owner, ast.ClassDef):
            functions += [(f"{owner.name}.{n.name}", n) for n in owner.body if isinstance(n, ast.FunctionDef)]
    return functions


def run_gate(mutation: Mutation | None) -> Row:
    """Run the accuracy gate on a copy of the package; return whether it passed, failed tests and measured errors."""
    with tempfile.TemporaryDirectory() as folder:
        sources = Path(folder) / "src"
        shutil.copytree(ROOT / "src", sources, ignore=shutil.ignore_patterns("__pycache__"))
        if mutation is not None:
            mutate(sources, mutation)
        environment = {**os.environ, "PYTHONPATH": str(sources), "PYTHONDONTWRITEBYTECODE": "1"}
        report = Path(folder) / "report.xml"
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider"]
        command += ["-o", "junit_family=xunit1", f"--junitxml={report}", str(GATE)]
        done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
        if done.returncode not in (0, 1):
            raise RuntimeError(f"pytest ended with {done.returncode}:\n{done.stdout}{done.stderr}")
        cases = list(ElementTree.parse(report).iter("testcase"))
    failed = [c.attrib["name"] for c in cases if c.find("failure") is not None or c.find("error") is not None]
    errors = {}
    for case in cases:
        measured = {p.attrib["name"]: float(p.attrib["value"]) for p in case.iter("property")}
        if measured:
            errors[re.sub(r".*\[(.*)\]", r"\1", case.attrib["name"])] = measured
    return {"passed": done.returncode == 0, "failed": failed, "errors": errors}


def shown(name: str, row: Row) -> Row:
    """Return a result as shown in the table, with the largest error relative to its limit."""
    shares = {name: measured["error"] / measured["limit"] for name, measured in row["errors"].items()}
    worst = max(shares, key=lambda name: shares[name], default="")
    return {
        "mutation": name,
        "gate": "passes" if row["passed"] else "fails",
        "as it should": row["passed"] == (name == CLEAN),
        "failed tests": len(row["failed"]),
        "largest error / limit": shares.get(worst),
        "of": worst,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    names = [mutation.name for mutation in MUTATIONS]
    parser.add_argument("--only", action="append", choices=names, help="Apply only this mutation.")
    parser.add_argument("--results", type=Path, help="Folder of results; existing ones aren't run again.")
    arguments = parser.parse_args()
    chosen = [m for m in MUTATIONS if arguments.only is None or m.name in arguments.only]
    with tempfile.TemporaryDirectory() as folder:
        names = [CLEAN, *(mutation.name for mutation in chosen)]
        calls = {name: partial(run_gate, one) for name, one in zip(names, (None, *chosen), strict=True)}
        rows = measured(calls, arguments.results or Path(folder))
    summary = [shown(name, row) for name, row in zip(names, rows, strict=True)]
    print(table_of("Mutations", summary, list(summary[0])))
    sys.exit(0 if all(row["as it should"] for row in summary) else 1)


if __name__ == "__main__":
    main()
