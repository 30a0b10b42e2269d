"""Versions, dependencies and licences are stated consistently outside the code."""

from __future__ import annotations

import re
import tomllib
from importlib.metadata import PackageNotFoundError, metadata
from pathlib import Path

import pytest
import yaml

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


CONDA = {"opencv-python-headless": "py-opencv", "matplotlib": "matplotlib-base"}
"""Packages with another name in conda; its \"matplotlib\" also installs GUI libraries."""


def test_the_conda_recipe_follows_the_package() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    stated, building = project["project"], project["build-system"]["requires"]
    recipe = yaml.safe_load((ROOT / "recipe" / "recipe.yaml").read_text())
    split = [re.match(r"([\w-]+)(.*)", text) for text in [*stated["dependencies"], *building]]
    wanted = [f"{CONDA.get(m[1], m[1])} {m[2]}" for m in split if m]
    python = f"python {stated['requires-python']}"
    needed = recipe["requirements"]
    assert sorted([*needed["run"], *needed["host"]]) == sorted([*wanted, python, python, "pip"])
    assert recipe["context"]["version"] == stated["version"]
    assert recipe["build"]["python"]["entry_points"] == [f"ospc = {stated['scripts']['ospc']}"]
    about = recipe["about"]
    assert (about["summary"], about["license"]) == (stated["description"], stated["license"])
    assert about["license_file"] == stated["license-files"]


BUILDING = {"editables", "hatchling", "pathspec", "pluggy", "tomlkit", "trove-classifiers"}
"""Packages of user.lock that are only needed to build and install ospc."""


def licence(name: str) -> str:
    """Return the licence of a package from the three metadata fields that may contain it."""
    try:
        said = metadata(name)
    except PackageNotFoundError:
        return ""  # needed only on other systems
    classifiers = [text for text in said.get_all("Classifier", []) if text.startswith("License")]
    return " ".join([said.get("License-Expression", ""), *classifiers, said.get("License", "")[:200]]).strip()


def test_no_package_that_users_need_binds_them_to_the_gpl() -> None:
    names = set(pinned("user.lock"))
    licences = {name: licence(name) for name in names}
    assert sum(bool(text) for text in licences.values()) > 10
    assert not [name for name, text in licences.items() if re.search(r"GPL|General Public", text)]


def test_the_documentation_lists_the_licences_of_all_packages() -> None:
    text = (ROOT / "docs" / "install.md").read_text()
    listed = set(re.findall(r"^\| ([\w.-]+) \|", text.partition("## Licences")[2], re.MULTILINE))
    assert listed - {"package", "---"} == set(pinned("user.lock")) - BUILDING
