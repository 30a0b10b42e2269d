"""Declaration of options as defaults of a command's parameters, and options shared by several commands."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from ospc.errors import SettingError
from ospc.system.folders import check_new, check_usable, reserved

if TYPE_CHECKING:
    from ospc.exposures.lag_choice import LagChoice

_HELP_COLUMNS = 76
"""Width of help texts in a terminal of 80 columns, without their indentation."""
_OF_ANNOTATION: Mapping[str, Mapping[str, Any]] = {
    "bool": {"is_flag": True},
    "int": {"type": int},
    "float": {"type": float},
    "Path": {"type": click.Path(path_type=Path)},
}
"""Attributes of an option by the annotation of its parameter; ``tuple[…, ...]`` makes it repeatable."""


class Declared(NamedTuple):
    """The default of a parameter: the declaration of its option or argument.

    With ``reserve``, the folder is created and reserved for this process while the command runs. Arguments have no
    flags; the attributes are click's.
    """

    flags: tuple[str, ...] | None
    attributes: Mapping[str, Any]
    reserve: bool = False

    def parameters(self, name: str, annotation: str) -> list[click.Parameter]:
        """Return click's parameters for a parameter of this name and annotation."""
        several = annotation.startswith("tuple[") and annotation.endswith(", ...]")
        item = annotation.removeprefix("tuple[").removesuffix(", ...]").removesuffix(" | None")
        attributes = {**_OF_ANNOTATION.get(item, {}), **self.attributes}
        if self.flags is None:
            return [click.Argument([name], **({"nargs": -1} if several else {}) | attributes)]
        flags = self.flags or (f"--{name.replace('_', '-')}",)
        return [click.Option([*flags, name], **{"multiple": several} | attributes)]

    def pop_value(self, name: str, values: dict[str, Any]) -> Any:
        """Remove the parameter's value from those that click has parsed, and return it."""
        return values.pop(name)


class OptionGroup(NamedTuple):
    """Declares several options that ``make`` combines into the value of one parameter."""

    make: Callable[..., Any]
    parts: Mapping[str, Declared]
    reserve: bool = False

    def parameters(self, _name: str, _annotation: str) -> list[click.Parameter]:
        """Return click's parameters."""
        return [parameter for name, part in self.parts.items() for parameter in part.parameters(name, "")]

    def pop_value(self, _name: str, values: dict[str, Any]) -> Any:
        """Remove the values of all parts, and return the combined value."""
        return self.make(**{name: part.pop_value(name, values) for name, part in self.parts.items()})


def option(help: str | None, *flags: str, **attributes: Any) -> Any:  # noqa: A002
    """Declare an option; its flag is the parameter's name by default."""
    return Declared(flags, {"help": help} | attributes)


def argument(*, reserve: bool = False, **attributes: Any) -> Any:
    """Declare an argument."""
    return Declared(None, attributes, reserve=reserve)


def out_option(help: str, *, folder: bool = True, **attributes: Any) -> Any:  # noqa: A002
    """Declare the option for the file or folder to write, which is required unless there is a default."""
    usual = {} if "default" in attributes else {"required": True}
    return Declared(("-o", "--out"), {"help": help} | usual | attributes, reserve=folder)


def declared(
    name: str, group: click.Group | None = None, *, exits: Mapping[int, str] | None = None, **attributes: Any
) -> Callable[[Callable[..., Any]], click.Command]:
    """Make a command of a function, or of a dataclass with a method ``run``; its parameter defaults declare options.

    A parameter without a default gets the :class:`~ospc.cli.interruption.Interruption`. The command returns its exit
    code, or None for 0; ``exits`` explains the codes at the end of the help text.
    """

    def made(work: Callable[..., Any]) -> click.Command:
        signature = inspect.signature(work).parameters
        options = {name: p.default for name, p in signature.items() if isinstance(p.default, Declared | OptionGroup)}

        def call(**values: Any) -> Any:
            given = {name: option.pop_value(name, values) for name, option in options.items()}
            context = {name: click.get_current_context().obj for name in signature.keys() - options.keys()}
            with ExitStack() as stack:
                for folder in (given[name] for name, option in options.items() if option.reserve):
                    if folder is not None:
                        stack.enter_context(reserved(folder))
                done = work(**context, **given)
                return done.run() if hasattr(done, "run") else done

        command = click.Command(
            name,
            callback=call,
            params=[
                parameter
                for name, option in options.items()
                for parameter in option.parameters(name, signature[name].annotation)
            ],
            **{"help": inspect.getdoc(work), "epilog": exits and _exit_codes(exits)} | attributes,
        )
        if group is not None:
            group.add_command(command)
        return command

    return made


def _exit_codes(meanings: Mapping[int, str]) -> str:
    """Return the list of exit codes for the end of a help text, with those of errors and usage errors added."""
    every = {1: "error", 2: "usage error", **meanings}
    formatter = click.HelpFormatter(width=_HELP_COLUMNS)
    with formatter.section("Exit codes"):
        formatter.write_dl([(str(code), every[code]) for code in sorted(every)])
    return "\b\n" + formatter.getvalue()


class Parsed(click.ParamType):  # type: ignore[type-arg]  # generic in new versions of click only
    """A value parsed by a function; its ``SettingError`` is a usage error."""

    def __init__(self, name: str, parse: Callable[[str], Any]) -> None:
        self.name, self._parse = name, parse

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the value."""
        try:
            return self._parse(value)
        except SettingError as error:
            self.fail(str(error), param, ctx)


def _size(text: str, least: int, most: int) -> tuple[int, int]:
    """Return width and height such as ``640x480``."""
    match = re.fullmatch(r"\s*(\d{1,6})\s*[xX×]\s*(\d{1,6})\s*", text)
    size = (0, 0) if match is None else (int(match[1]), int(match[2]))
    if not all(least <= side <= most for side in size):
        raise SettingError(f"{text!r} is not a size such as 640x480, with sides of {least} to {most} pixels")
    return size


def _lag(text: str) -> LagChoice:
    from ospc.exposures.lag_choice import lag_choice

    return lag_choice(text)


def _picture(plot: Path | None, *, force: bool) -> Path | None:
    """Refuse a picture that cannot be written, before anything is computed for it."""
    if plot is not None:
        if plot.is_dir():
            raise SettingError(f"{plot}: is a folder; name a file")
        if not plot.parent.is_dir():
            raise SettingError(f"{plot}: the folder {plot.parent} does not exist; make it, or choose another one")
        check_usable(plot.parent)
        check_new([plot], force=force)
    return plot


def parse_assignments(entries: Iterable[str], example: str) -> dict[str, str]:
    """Return entries NAME=VALUE as a dictionary; the usage error shows the example."""
    found: dict[str, str] = {}
    for entry in entries:
        name, equals, value = (part.strip() for part in entry.partition("="))
        if not (name and equals and value):
            raise click.UsageError(f"{entry!r} is not NAME=VALUE, such as {example}")
        found[name] = value
    return found


SIZE = Parsed("size", partial(_size, least=1, most=999_999))
STUDY_SIZE = Parsed("size", partial(_size, least=16, most=8192))
"""Image size of a study: smaller images show nothing, and larger ones take days."""

QUIET = option("Print only errors and warnings.", "-q", "--quiet")
AS_JSON = option("Print the result as JSON on standard output.", "--json")
FORCE = option("Write into OUT even if it contains other files; those with names of results are replaced.")
PLOT: Any = OptionGroup(
    _picture,
    {
        "plot": option("Draw the result into this picture file.", type=click.Path(path_type=Path)),
        "force": option("Replace the picture if it exists.", is_flag=True),
    },
)
IMAGE_SIZE = option("Size of the images; by default that stated in the files.", metavar="WxH", type=SIZE)
TRUTH = option(
    "A known calibration to compare with: calibration.json, or a folder with pcalib.txt and vignette.png.",
    metavar="PATH",
)
ASSUME_MISSING = option("Treat an unknown response as linear, and an unknown vignette as none.")
LIST_TOPICS = option("Print the topics of the bag at PATH and exit.")
CORRECT_LAG = option(
    "Correction of exposures recorded with the wrong frames: auto corrects the lag if the images show it with "
    "certainty; never leaves the exposures as recorded; N corrects N frames, positive if exposures are late.",
    metavar="auto|never|N",
    type=Parsed("lag", _lag),
    default="auto",
)
