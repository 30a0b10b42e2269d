"""Options for reading a recording, shared by the commands that read one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import click

from ospc.cli.options import Declared, OptionGroup, Parsed, option
from ospc.cli.terminal import say, say_table
from ospc.errors import ExposureError, RecordingError, SettingError, named
from ospc.recording import Recording, cameras_of, open_recording
from ospc.recording.channel import Channel
from ospc.recording.derived import Region, masked, read_mask
from ospc.recording.kinds import kinds
from ospc.recording.options import ReadingOptions, declared_options

_EACH = "each"
"""Value of ``--channel`` that calibrates each channel separately."""
_EACH_HELP = (
    " With each ('ospc calibrate' only), red, green and blue are calibrated into OUT/red, OUT/green and OUT/blue."
)
_WIDTH_WHEN_PIPED = 200
"""Characters per line of a table outside a terminal; long topic names fit."""


@dataclass(frozen=True)
class Reading:
    """How to read a recording; ``kind`` is None to recognise it, ``mask`` is the file of a mask."""

    options: ReadingOptions
    kind: str | None = None
    mask: Path | None = None
    region: Region | None = None
    each_channel: bool = False

    def open(self, path: Path) -> Recording:
        """Open a recording; the error for missing exposures suggests ``--unknown-exposures``."""
        if self.each_channel:
            raise click.UsageError("only 'ospc calibrate' accepts --channel each; choose one channel")
        return self._opened(path, self.options)

    def cameras(self, path: Path) -> dict[str, Callable[[], Recording]]:
        """Return an opener for each camera of a rig by name, or for each of its channels with ``--channel each``."""
        _refuse_camera(path)
        cameras = cameras_of(path, self.kind, self.options)
        if not self.each_channel:
            return {name: partial(self._opened, *camera) for name, camera in cameras.items()}
        return {
            f"{name}_{channel.value}" if len(cameras) > 1 else channel.value: partial(
                self._opened, place, replace(options, channel=channel)
            )
            for channel in (Channel.RED, Channel.GREEN, Channel.BLUE)
            for name, (place, options) in cameras.items()
        }

    def _opened(self, path: Path, options: ReadingOptions) -> Recording:
        _refuse_camera(path)
        try:
            recording = open_recording(path, self.kind, options)
        except RecordingError as error:
            if options.unknown_exposures:
                raise
            # A problem that prevents opening it even without exposures takes precedence.
            open_recording(path, self.kind, replace(options, unknown_exposures=True))
            hint = "if no exposures are known, 'ospc calibrate --unknown-exposures' estimates them from the images"
            raise ExposureError(f"{error}; {hint}") from error
        mask = None if self.mask is None else read_mask(self.mask, recording.size)
        return masked(recording, mask, self.region)


def _refuse_camera(path: Path) -> None:
    if path.exists():
        return
    from ospc.recording.live import names_camera

    if names_camera(str(path)):
        raise SettingError(
            f"{path}: is a camera, not a recording; calibrate it with 'ospc live {path} -o OUT', or record it first "
            f"with 'ospc record {path} -o OUT'"
        )


def _reading(
    kind: str | None, mask: Path | None, roi: Region | None, *, unknown_exposures: bool = False, **stated: str | None
) -> Reading:
    each = stated["channel"] == _EACH
    options = ReadingOptions.of(stated | {"channel": None} if each else stated)
    return Reading(replace(options, unknown_exposures=unknown_exposures), kind, mask, roi, each)


def _known_kind(name: str) -> str:
    return named("kind of recording", name, {kind.name: kind.name for kind in kinds()})


KIND = option("Kind of recording (tum_mono, euroc, …); recognised by default.", type=Parsed("kind", _known_kind))


def _stated(name: str, *, each: bool = False, text: str = "") -> Any:
    """Declare the option for a field of :class:`ReadingOptions`; with ``each``, that word is a choice too."""
    stated = declared_options()[name]
    choices = (*stated.choices, _EACH) if each else stated.choices
    flags = (f"--{name.replace('_', '-')}", *stated.aliases)
    text = (text or stated.help) + (_EACH_HELP if each else "")
    return option(text, *flags, type=click.Choice(choices) if choices else None, metavar=stated.metavar)


_STATED: dict[str, Declared] = {name: _stated(name) for name in declared_options()}
_READING: dict[str, Declared] = {
    "kind": KIND,
    **_STATED,
    "channel": _stated("channel", each=True),
    "mask": option(
        "Image of the same size as the frames; pixels that are black in it are not used.",
        type=click.Path(path_type=Path),
        metavar="IMAGE",
    ),
    "roi": option(
        "Use only this part of the image, in pixels.", metavar="X,Y,W,H", type=Parsed("region", Region.parse)
    ),
}
_UNKNOWN_EXPOSURES = option(
    "Estimate the exposures from the images and ignore recorded ones. Response, vignette and exposures are then "
    "known only up to one exponent, and labelled as such.",
    is_flag=True,
)

READING: Any = OptionGroup(_reading, _READING)
"""Declares a :class:`Reading`."""
READING_OR_ESTIMATING: Any = OptionGroup(_reading, _READING | {"unknown_exposures": _UNKNOWN_EXPOSURES})
"""The same with ``--unknown-exposures``, for commands that can estimate exposures."""


def _options(**stated: str | None) -> ReadingOptions:
    return ReadingOptions.of(stated)


STATED: Any = OptionGroup(_options, _STATED)
"""Declares :class:`ReadingOptions` alone."""
_ONE_CHANNEL = "Write only this channel of colour or Bayer images, which otherwise remain in colour."
STATED_IN_COLOUR: Any = OptionGroup(_options, _STATED | {"channel": _stated("channel", text=_ONE_CHANNEL)})
"""The same for a command that keeps colours."""
STATED_OF_CAMERA: Any = OptionGroup(_options, {n: _STATED[n] for n in ("channel", "exposure_unit", "gain_unit")})
"""The same, reduced to the options that apply to a connected camera."""


def print_topics(path: Path) -> None:
    """Print the topics of a bag and their possible uses."""
    from rich.text import Text

    from ospc.recording.bags.bag import Bag, uses

    rows = [
        (Text(topic.name), Text(topic.type), "?" if topic.messages is None else str(topic.messages), Text(use))
        for topic, use in uses(Bag.at(path))
    ]
    if rows:
        say_table(
            ("topic", "type", "messages", "content"), rows, right="messages", columns_when_piped=_WIDTH_WHEN_PIPED
        )
    else:
        say(f"{path}: no topics")
