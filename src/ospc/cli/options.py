"""Options and arguments that several commands share, each declared once."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Callable, Iterable
from contextlib import nullcontext
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

import click

from ospc.errors import SettingError
from ospc.folders import check_usable, reserved

if TYPE_CHECKING:
    from ospc.exposures.findings import LagChoice

_Command = TypeVar("_Command", bound=Callable[..., Any])

PATH = click.Path(path_type=Path)

_MOST_LAG_FRAMES = 1000
"""Largest lag that can be stated; no camera buffers nearly as many frames."""

_HELP_COLUMNS = 76
"""Width of help texts in a terminal of 80 columns, less their indentation."""


class _Size(click.ParamType):  # type: ignore[type-arg]  # generic in new versions of click only
    """Width and height such as ``640x480``."""

    name = "size"

    def __init__(self, least: int = 1, most: int = 999_999) -> None:
        self._least, self._most = least, most

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[int, int]:
        """Return width and height in pixels."""
        if isinstance(value, tuple):
            return value
        match = re.fullmatch(r"\s*(\d{1,6})\s*[xX×]\s*(\d{1,6})\s*", str(value))
        size = (0, 0) if match is None else (int(match[1]), int(match[2]))
        if not all(self._least <= side <= self._most for side in size):
            self.fail(
                f"{value!r} is not a size such as 640x480, of {self._least} to {self._most} pixels a side", param, ctx
            )
        return size


class _Lag(click.ParamType):  # type: ignore[type-arg]
    """``auto``, ``never`` or a number of frames."""

    name = "lag"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> LagChoice:
        """Return ``"auto"``, ``"never"``, or a number of frames."""
        from ospc.exposures.findings import lag_choice

        try:
            choice = lag_choice(str(value))
        except SettingError as error:
            self.fail(str(error), param, ctx)
        if isinstance(choice, int) and abs(choice) > _MOST_LAG_FRAMES:
            self.fail(
                f"no camera is {abs(choice)} frames late; at most {_MOST_LAG_FRAMES} can be corrected", param, ctx
            )
        return choice


SIZE = _Size()
STUDY_SIZE = _Size(16, 8192)
"""Size of the images of a study: smaller ones show nothing, and larger ones take days."""


def reserving_out(command: _Command) -> _Command:
    """Make the folder of the option ``out`` and keep other processes out of it while the command runs."""

    @wraps(command)
    def reserving(*args: Any, out: Path | None, **options: Any) -> Any:
        with nullcontext() if out is None else reserved(out):
            return command(*args, out=out, **options)

    return cast("_Command", reserving)


def _writable(_ctx: click.Context, _param: click.Parameter, place: Path | None) -> Path | None:
    """Refuse a file that cannot be written before anything is computed for it."""
    if place is not None:
        if place.is_dir() or not place.parent.is_dir():
            raise SettingError(f"{place}: is a folder, or lies in none; name a file in a folder that exists")
        check_usable(place.parent)
    return place


def out_option(
    default: str | None = None,
    *,
    required: bool = True,
    folder: bool = True,
    help: str,  # noqa: A002 (as click names it)
) -> Callable[[_Command], _Command]:
    """Return the option for the file or folder to write; a default makes it optional.

    A folder is made, and kept for this process alone while the command runs.
    """
    usual: dict[str, Any] = {"default": Path(default)} if default else {"required": required}
    option = click.option("-o", "--out", type=PATH, help=help, **usual)
    return lambda command: option(reserving_out(command) if folder else command)


COMPLETE, UNDETERMINED = 0, 3
"""Exit codes of every command that calibrates: everything is identifiable and nothing warns, or something is not."""


def exit_codes(meanings: dict[int, str]) -> str:
    """Return the list of exit codes for the end of a help text; that of errors and wrong usage is added."""
    every = {1: "error", 2: "wrong usage"} | meanings
    width = max(len(str(code)) for code in every)
    lines = [
        textwrap.fill(
            every[code], _HELP_COLUMNS, initial_indent=f"  {code:<{width}}  ", subsequent_indent=" " * (width + 4)
        )
        for code in sorted(every)
    ]
    return "\b\n" + "\n".join(["Exit codes:", *lines])


def force_option(help: str) -> Callable[[_Command], _Command]:  # noqa: A002 (as click names it)
    """Return the option to write into a folder that is in use."""
    return click.option("--force", is_flag=True, help=help)


path_argument = click.argument("path", type=PATH)
quiet_option = click.option("-q", "--quiet", is_flag=True, help="Print only errors and warnings.")
json_option = click.option("--json", "as_json", is_flag=True, help="Print the result as JSON on standard output.")
plot_option = click.option("--plot", type=PATH, callback=_writable, help="Draw the result into this picture.")
kind_option = click.option(
    "--kind", metavar="KIND", help="Kind of recording (tum_mono, euroc, …); by default recognised."
)
size_option = click.option(
    "--size", metavar="WxH", type=SIZE, help="Size of the images; by default what the files state."
)
truth_option = click.option(
    "--truth",
    metavar="PATH",
    help="A known calibration to compare with: calibration.json, or a folder with pcalib.txt and vignette.png.",
)
assume_missing_option = click.option(
    "--assume-missing", is_flag=True, help="Take an unknown response as linear, and an unknown vignette as none."
)
unknown_exposures_option = click.option(
    "--unknown-exposures",
    is_flag=True,
    help="Estimate the exposures from the images, whatever the recording says of them: everything is then known only "
    "up to one exponent, and labelled so.",
)
list_topics_option = click.option(
    "--list-topics", is_flag=True, help="Print the topics of the bag at PATH, and do nothing else."
)
correct_lag_option = click.option(
    "--correct-lag",
    metavar="auto|never|N",
    type=_Lag(),
    default="auto",
    help="What to do where exposures are written beside other frames than theirs: correct that if the images show by "
    "how many frames (auto), never, or correct it by N frames; positive if exposures come late.",
)


def named(entries: Iterable[str], example: str) -> dict[str, str]:
    """Return entries NAME=VALUE as a dictionary; a usage error names the example."""
    found: dict[str, str] = {}
    for entry in entries:
        name, equals, value = (part.strip() for part in entry.partition("="))
        if not (name and equals and value):
            raise click.UsageError(f"{entry!r} is not NAME=VALUE, such as {example}")
        found[name] = value
    return found
