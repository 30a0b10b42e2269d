"""The documentation builds without a single warning: links, references, formulas, docstrings."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from documented_code import DOCS


def test_site_builds_without_warnings(tmp_path: Path) -> None:
    pytest.importorskip("sphinx", reason="needs the extra 'docs'")
    built = subprocess.run(
        [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-b", "dummy", str(DOCS), str(tmp_path)],
        check=False,
        capture_output=True,
        text=True,
    )
    assert built.returncode == 0, built.stderr
