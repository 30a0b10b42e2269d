"""Options that say how a recording is read, shared by the commands that read one."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import click

from ospc.cli.options import PATH
from ospc.cli.terminal import console, say
from ospc.errors import ExposureError, RecordingError, SettingError
from ospc.recording import Recording, cameras_of
from ospc.recording.derived import Region, masked, read_mask
from ospc.recording.kinds import kinds
from ospc.recording.options import ReadingOptions, declared_options

EACH = "each"
"""Value of ``--channel`` for one calibration of each channel."""

_EACH_HELP = " With each, 'ospc calibrate' calibrates red, green and blue into OUT/red, OUT/green and OUT/blue."
_WIDTH_WHEN_PIPED = 200
"""Characters per line of a table that does not go to a terminal; long topic names fit."""

_Command = TypeVar("_Command", bound=Callable[..., Any])
_Opener = Callable[[], Recording]


@dataclass(frozen=True)
class Reading:
    """How the user wants a recording to be read; ``kind`` is None to recognise it, ``mask`` the file of a mask."""

    options: ReadingOptions
    kind: str | None = None
    mask: Path | None = None
    region: Region | None = None
    each_channel: bool = False

    @classmethod
    def taken_from(cls, options: dict[str, Any]) -> Reading:
        """Take these options out of all options of a command."""
        each = options.get("channel") == EACH
        if each:
            del options["channel"]
        return cls(taken_options(options), options.pop("kind"), options.pop("mask"), options.pop("roi"), each)

    def open(self, path: Path) -> Recording:
        """Open a recording; an error for want of exposures names the option to go without them."""
        if self.each_channel:
            raise click.UsageError("only 'ospc calibrate' takes --channel each; choose one channel")
        from ospc.recording import open_recording

        return self._opened(path, lambda options: open_recording(path, self.kind, options))

    def cameras(self, path: Path) -> dict[str, _Opener]:
        """Return an opener for each camera of a rig by its name, or for each of its channels if asked for."""
        if not self.each_channel:
            return {name: partial(self._camera, path, name) for name in cameras_of(path, self.kind, self.options)}
        of_channels = {name: self._of_channel(name).cameras(path) for name in ("red", "green", "blue")}
        several = len(of_channels["green"]) > 1
        return {
            f"{name}_{channel}" if several else channel: opener
            for channel, cameras in of_channels.items()
            for name, opener in cameras.items()
        }

    def _camera(self, path: Path, name: str) -> Recording:
        return self._opened(path, lambda options: cameras_of(path, self.kind, options)[name]())

    def _of_channel(self, name: str) -> Reading:
        channel = ReadingOptions.of({"channel": name}).channel
        return replace(self, options=replace(self.options, channel=channel), each_channel=False)

    def _opened(self, path: Path, opener: Callable[[ReadingOptions], Recording]) -> Recording:
        try:
            recording = opener(self.options)
        except RecordingError as error:
            if self.options.unknown_exposures:
                raise
            # What keeps it from being opened without exposures, too, is to be mended first.
            opener(replace(self.options, unknown_exposures=True))
            hint = "if there are none, 'ospc calibrate --unknown-exposures' estimates them from the images"
            raise ExposureError(f"{error}; {hint}") from error
        mask = None if self.mask is None else read_mask(self.mask, recording.size)
        return masked(recording, mask, self.region)


def _check_kind(_ctx: click.Context, _param: click.Parameter, value: str | None) -> str | None:
    known = [kind.name for kind in kinds()] if value is not None else []
    if value is not None and value not in known:
        raise click.BadParameter(f"{value!r} is not a kind of recording; known: {', '.join(known)}")
    return value


def _parse_region(_ctx: click.Context, _param: click.Parameter, value: str | None) -> Region | None:
    try:
        return None if value is None else Region.parse(value)
    except SettingError as error:
        raise click.BadParameter(str(error)) from None


def stated_option(name: str, *, each: bool = False) -> Callable[[_Command], _Command]:
    """Make the command-line option for a field of :class:`~ospc.recording.options.ReadingOptions`.

    With ``each``, it also takes :data:`EACH`.
    """
    option = declared_options()[name]
    choices = (*option.choices, EACH) if each else option.choices
    return click.option(
        f"--{name.replace('_', '-')}",
        *option.aliases,
        name,
        type=click.Choice(choices) if choices else None,
        metavar=option.metavar,
        help=option.help + (_EACH_HELP if each else ""),
    )


def taken_options(options: dict[str, Any]) -> ReadingOptions:
    """Take what the user states about a recording out of all options of a command."""
    unknown_exposures = bool(options.pop("unknown_exposures", False))
    texts = {name: options.pop(name) for name in declared_options() if name in options}
    return replace(ReadingOptions.of(texts), unknown_exposures=unknown_exposures)


def stated_options(command: _Command, *, each: bool = False) -> _Command:
    """Give a command an option for every field but ``unknown_exposures``, which only some commands accept."""
    names = [name for name in declared_options() if name != "unknown_exposures"]
    for name in reversed(names):
        command = stated_option(name, each=each and name == "channel")(command)
    return command


def reading_options(command: _Command) -> _Command:
    """Give a command the options that :class:`Reading` takes; 'ospc calibrate' adds ``--unknown-exposures``."""
    mask = click.option(
        "--mask",
        type=PATH,
        metavar="IMAGE",
        help="Image of the frames' size; pixels that are black in it are not used.",
    )
    region = click.option(
        "--roi", metavar="X,Y,W,H", callback=_parse_region, help="Use only this part of the image, in pixels."
    )
    kind = click.option(
        "--kind", callback=_check_kind, help="Kind of recording, instead of recognising it (tum_mono, euroc, …)."
    )
    return kind(stated_options(mask(region(command)), each=True))


def print_topics(path: Path) -> None:
    """Print the topics of a bag, and what each can be used for."""
    from rich.table import Table
    from rich.text import Text

    from ospc.recording.bags.bag import Bag, uses

    table = Table(show_edge=False, pad_edge=False, header_style="bold")
    for heading in ("topic", "type", "messages", "holds"):
        table.add_column(heading, overflow="fold", justify="right" if heading == "messages" else "left")
    for topic, use in uses(Bag.at(path)):
        count = "?" if topic.messages is None else str(topic.messages)
        table.add_row(Text(topic.name), Text(topic.type), count, Text(use))
    if table.row_count:
        console(width=None if sys.stdout.isatty() else _WIDTH_WHEN_PIPED).print(table)
    else:
        say(f"{path}: has no topics")
