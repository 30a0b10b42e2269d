"""The public interface: exported names, cost of the import, and type annotations."""

from __future__ import annotations

import ast
import importlib
import inspect
import json
import subprocess
import sys
import typing
from importlib.metadata import version
from importlib.resources import files

import pytest

import ospc

NAMES = {
    "Calibration",
    "Frame",
    "LiveCalibrator",
    "Observations",
    "OnlineCalibrator",
    "OspcError",
    "Recording",
    "Response",
    "Vignette",
    "__version__",
    "calibrate",
    "calibrate_observations",
    "fit",
    "open_recording",
    "simulate",
}
HEAVY = ("numpy", "scipy", "cv2", "matplotlib", "mahotas", "rich")


def modules_after(code):
    """Return the names of the modules that a fresh interpreter has loaded after running code."""
    script = f"{code}\nimport sys, json\nprint(json.dumps(sorted(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    return set(json.loads(done.stdout.splitlines()[-1]))


def test_all_public_names_are_there_and_listed():
    assert set(ospc.__all__) == NAMES
    assert set(dir(ospc)) >= NAMES
    for name in NAMES:
        assert getattr(ospc, name) is not None


def test_tools_that_do_not_run_the_package_find_the_names():
    (names,) = (
        node.value
        for node in ast.parse(inspect.getsource(ospc)).body
        if isinstance(node, ast.Assign) and node.targets[0].id == "__all__"
    )
    assert set(ast.literal_eval(names)) == NAMES


def test_names_are_those_of_the_modules_they_live_in():
    for name in NAMES - {"__version__"}:
        value = getattr(ospc, name)
        assert value.__module__.startswith("ospc.")
        assert getattr(importlib.import_module(value.__module__), name) is value


def test_other_names_are_refused_as_usual():
    with pytest.raises(AttributeError, match="module 'ospc' has no attribute 'callibrate'"):
        _ = ospc.callibrate
    assert not hasattr(ospc, "cli2")


def test_the_version_is_that_of_the_package():
    assert ospc.__version__ == version("ospc")


def test_importing_the_package_loads_nothing_heavy():
    loaded = modules_after("import ospc")
    assert loaded.isdisjoint(HEAVY)
    assert {name for name in loaded if name.startswith("ospc")} == {"ospc"}


def test_help_loads_nothing_heavy():
    code = """
import contextlib, io
from ospc.cli.main import cli
with contextlib.redirect_stdout(io.StringIO()) as shown:
    cli(["--help"], prog_name="ospc", standalone_mode=False)
assert "calibrate" in shown.getvalue()
"""
    assert modules_after(code).isdisjoint(HEAVY)


def test_a_value_type_does_not_need_the_image_library():
    assert "cv2" not in modules_after("from ospc import Response, Calibration; Response.gamma(2.2)")


def test_the_package_says_that_it_is_typed():
    assert files("ospc").joinpath("py.typed").is_file()


def member_file(value):
    return value.__module__.rpartition(".")[2]


def members_of(value):
    """Yield the functions of a public name: the function itself, or the public methods defined by a class."""
    if inspect.isfunction(value):
        yield value
    for name, member in vars(value).items() if inspect.isclass(value) else ():
        inner = member.fget if isinstance(member, property) else getattr(member, "__func__", member)
        written_here = inspect.isfunction(inner) and inner.__code__.co_filename.endswith(f"{member_file(value)}.py")
        if written_here and (not name.startswith("_") or name == "__init__"):
            yield inner


@pytest.mark.parametrize("name", sorted(NAMES - {"__version__"}))
def test_every_parameter_and_result_is_annotated_and_documented(name):
    value = getattr(ospc, name)
    assert inspect.getdoc(value)
    for function in members_of(value):
        hints = set(typing.get_type_hints(function, vars(importlib.import_module(function.__module__))))
        parameters = [p for p in inspect.signature(function).parameters if p not in ("self", "cls")]
        assert hints >= {*parameters, "return"}, function.__qualname__
        assert inspect.getdoc(function) or function.__name__ == "__init__", function.__qualname__


def test_every_error_has_one_root():
    errors = importlib.import_module("ospc.errors")
    kinds = [k for k in vars(errors).values() if inspect.isclass(k) and issubclass(k, Exception)]
    assert len(kinds) >= 6
    assert all(issubclass(kind, ospc.OspcError) for kind in kinds)


def test_every_module_of_the_library_can_be_imported_without_side_effects():
    code = """
import pkgutil, importlib, contextlib, io, ospc
with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as err:
    for module in pkgutil.walk_packages(ospc.__path__, "ospc."):
        importlib.import_module(module.name)
assert not out.getvalue() and not err.getvalue()
"""
    loaded = modules_after(code)
    assert loaded.isdisjoint({"matplotlib", "mahotas"})
    assert "ospc.calibrator" in loaded
