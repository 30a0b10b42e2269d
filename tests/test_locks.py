"""The pinned environments: pip installs only files with known hashes."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

LOCKS = sorted((Path(__file__).parents[1] / "requirements").glob("*.lock"))


@pytest.mark.parametrize("lock", LOCKS, ids=lambda path: path.name)
def test_every_package_is_pinned_with_hashes_and_no_registry_is_named(lock):
    text = "\n".join(line for line in lock.read_text().splitlines() if not line.startswith("#"))
    packages = [entry for entry in re.split(r"\n(?=\S)", text) if entry]
    assert len(packages) > 20
    for package in packages:
        assert re.match(r"[\w.\-\[\]]+==\S+", package), package
        assert "--hash=sha256:" in package, package
    assert "://" not in text
