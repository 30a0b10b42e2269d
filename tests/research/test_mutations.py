"""The mutations of ``benchmarks/mutations.py`` can be applied; running the gate on them takes too long."""

from __future__ import annotations

import ast
import importlib
import shutil
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


def test_every_mutation_changes_one_function(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(BENCHMARKS)
    program = importlib.import_module("mutations")
    shutil.copytree(program.ROOT / "src", tmp_path, ignore=shutil.ignore_patterns("__pycache__"), dirs_exist_ok=True)
    texts = {path: path.read_text(encoding="utf-8") for path in tmp_path.rglob("*.py")}
    for mutation in program.MUTATIONS:
        program.mutate(tmp_path, mutation)
        changed = [path for path, text in texts.items() if path.read_text(encoding="utf-8") != text]
        assert len(changed) == 1, mutation.name
        ast.parse(changed[0].read_text(encoding="utf-8"))
        changed[0].write_text(texts[changed[0]], encoding="utf-8")
