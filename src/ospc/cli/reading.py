"""Options that say how a recording is read, shared by the commands that read one."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

if TYPE_CHECKING:
    from ospc.recording import Recording
    from ospc.recording.options import ReadingOptions

EACH = "each"
"""Value of ``--channel`` for one calibration of each channel."""

_Command = TypeVar("_Command", bound=Callable[..., Any])


@dataclass(frozen=True)
class Reading:
    """What the user says about how a recording is read, option by option; None for what its content tells."""

    kind: str | None = None
    channel: str | None = None
    bayer: str | None = None
    exposure_unit: str | None = None
    gain_unit: str | None = None
    image_topic: str | None = None
    exposure_topic: str | None = None
    exposure_field: str | None = None
    gain_field: str | None = None
    mask: Path | None = None
    roi: str | None = None
    unknown_exposures: bool = False

    @classmethod
    def taken_from(cls, options: dict[str, Any]) -> Reading:
        """Take these options out of all options of a command."""
        return cls(**{name: options.pop(name) for name in cls.__dataclass_fields__ if name in options})

    def options(self) -> ReadingOptions:
        """Return what readers are told."""
        from ospc.recording.bayer import Mosaic
        from ospc.recording.channel import Channel
        from ospc.recording.exposure_units import ExposureUnit, GainUnit
        from ospc.recording.options import ReadingOptions

        if self.channel == EACH:
            raise click.UsageError("only 'ospc calibrate' takes --channel each; choose one of them")
        return ReadingOptions(
            channel=Channel(self.channel) if self.channel else None,
            bayer=Mosaic(self.bayer) if self.bayer else None,
            exposure_unit=ExposureUnit(self.exposure_unit) if self.exposure_unit else None,
            gain_unit=GainUnit(self.gain_unit) if self.gain_unit else None,
            image_topic=self.image_topic,
            exposure_topic=self.exposure_topic,
            exposure_field=self.exposure_field,
            gain_field=self.gain_field,
            unknown_exposures=self.unknown_exposures,
        )

    def open(self, path: Path) -> Recording:
        """Open a recording.

        Raises
        ------
        RecordingError
            If it cannot be read.
        SettingError
            If an option does not fit it.
        """
        from ospc.recording import open_recording

        return self.masked(open_recording(path, self.kind, self.options()))

    def cameras(self, path: Path) -> dict[str, Callable[[], Recording]]:
        """Return what opens each camera of a rig, by its name; each channel counts as one where each is asked for.

        Raises
        ------
        RecordingError
            If the path cannot be read.
        """
        from ospc.recording import cameras_of

        if self.channel != EACH:
            found = cameras_of(path, self.kind, self.options())
            return {name: partial(self._opened, opened) for name, opened in found.items()}
        of_channels = {channel: replace(self, channel=channel).cameras(path) for channel in ("red", "green", "blue")}
        several = len(of_channels["green"]) > 1
        return {
            f"{name}_{channel}" if several else channel: opened
            for channel, cameras in of_channels.items()
            for name, opened in cameras.items()
        }

    def _opened(self, opened: Callable[[], Recording]) -> Recording:
        return self.masked(opened())

    def masked(self, recording: Recording) -> Recording:
        """Return the recording with what is masked out of it."""
        from ospc.recording.masking import Region, masked, read_mask

        region = None if self.roi is None else Region.parse(self.roi)
        return masked(recording, None if self.mask is None else read_mask(self.mask, recording.size), region)


def _check_kind(_ctx: click.Context, _param: click.Parameter, value: str | None) -> str | None:
    if value is not None:
        from ospc.recording.kinds import kinds

        known = [kind.name for kind in kinds()]
        if value not in known:
            raise click.BadParameter(f"{value!r} is no kind of recording; known: {', '.join(known)}")
    return value


def _check_region(_ctx: click.Context, _param: click.Parameter, value: str | None) -> str | None:
    if value is not None:
        from ospc.errors import SettingError
        from ospc.recording.masking import Region

        try:
            Region.parse(value)
        except SettingError as error:
            raise click.BadParameter(str(error)) from None
    return value


_OPTIONS = (
    click.option(
        "--kind", callback=_check_kind, help="Kind of recording, instead of recognising it (tum_mono, euroc, …)."
    ),
    click.option(
        "--channel",
        type=click.Choice(["luminance", "red", "green", "blue", EACH]),
        help="Channel of colour or Bayer images; by default the luminance of the first, the green of the second. "
        "With each, 'ospc calibrate' calibrates red, green and blue into OUT/red, OUT/green and OUT/blue.",
    ),
    click.option(
        "--bayer",
        type=click.Choice(["rggb", "bggr", "grbg", "gbrg"]),
        help="The images are a Bayer mosaic of this pattern.",
    ),
    click.option(
        "--exposure-unit",
        type=click.Choice(["s", "ms", "us", "ns", "100us", "log2s"]),
        help="Unit of the exposures, instead of inferring it.",
    ),
    click.option(
        "--gain-unit",
        type=click.Choice(["linear", "db", "iso", "none"]),
        help="Unit of the gains that exposures are multiplied by; none leaves gains out of account.",
    ),
    click.option("--image-topic", "--topic", metavar="TOPIC", help="Topic of a bag with the images."),
    click.option("--exposure-topic", metavar="TOPIC", help="Topic of a bag with the exposures."),
    click.option(
        "--exposure-field",
        metavar="FIELD",
        help="Field of these messages that is the exposure, as in info.shutter[0].",
    ),
    click.option("--gain-field", metavar="FIELD", help="Field of these messages that is a gain."),
    click.option(
        "--mask",
        type=click.Path(path_type=Path),
        metavar="IMAGE",
        help="Image of the frames' size; pixels that are black in it are not used.",
    ),
    click.option(
        "--roi", metavar="X,Y,W,H", callback=_check_region, help="Use only this part of the image, in pixels."
    ),
)


def reading_options(command: _Command) -> _Command:
    """Give a command the options that :class:`Reading` takes."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def say_topics(path: Path) -> None:
    """Print the topics of a bag, and what each is good for.

    Raises
    ------
    RecordingError
        If the path is no bag, or damaged.
    """
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from ospc.recording.bags.bag import Bag
    from ospc.recording.bags.topics import uses

    table = Table(show_edge=False, pad_edge=False, header_style="bold")
    for heading in ("topic", "type", "messages", "holds"):
        table.add_column(heading, overflow="fold", justify="right" if heading == "messages" else "left")
    for topic, use in uses(Bag.at(path)):
        count = "?" if topic.messages is None else str(topic.messages)
        table.add_row(Text(topic.name), Text(topic.type), count, use)
    console = Console(highlight=False, width=None if sys.stdout.isatty() else 200)
    console.print(table if table.row_count else f"{path}: has no topics", markup=False)
