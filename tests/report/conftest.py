"""Pictures are tested here."""

from __future__ import annotations

import pytest


@pytest.fixture(scope="module", autouse=True)
def pictures() -> None:
    """Render pictures in full."""
