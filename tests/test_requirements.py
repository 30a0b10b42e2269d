"""What is stated beside the code about versions is true of it."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

import ospc

ROOT = Path(__file__).parents[1]


def pinned(name: str) -> dict[str, str]:
    lines = (ROOT / "requirements" / name).read_text().splitlines()
    return {line.partition("==")[0].lower().replace("_", "-"): line for line in lines if "==" in line}


def test_users_get_the_versions_that_developers_test() -> None:
    assert pinned("user.lock").items() <= pinned("dev.lock").items()


def test_users_get_every_dependency() -> None:
    needed = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]
    assert {re.split(r"[<>=]", name)[0] for name in needed} <= set(pinned("user.lock"))


def test_the_container_is_made_from_files_that_exist_and_are_sent_to_its_builder() -> None:
    lines = (ROOT / "Dockerfile").read_text().splitlines()
    copied = [
        name for line in lines if line.startswith("COPY ") and "--from" not in line for name in line.split()[1:-1]
    ]
    sent = {line.removeprefix("!") for line in (ROOT / ".dockerignore").read_text().splitlines()}
    assert copied
    assert all((ROOT / name).exists() and name.split("/")[0] in sent for name in copied)


def test_every_extra_is_documented() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    for page in ("README.md", "docs/install.md"):
        assert all(f"`{name}`" in (ROOT / page).read_text() for name in extras), page


@pytest.mark.parametrize("name", ["CITATION.cff", "pyproject.toml"])
def test_the_version_is_the_same_everywhere(name: str) -> None:
    stated = re.search(r'^version\s*[:=]\s*"?([\d.]+)', (ROOT / name).read_text(), re.MULTILINE)
    assert stated is not None
    assert stated[1] == ospc.__version__
