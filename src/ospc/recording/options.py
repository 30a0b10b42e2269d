"""How a recording is read, as far as its content does not say."""

from __future__ import annotations

from dataclasses import dataclass

from ospc.recording.bayer import Mosaic
from ospc.recording.channel import Channel
from ospc.recording.exposure_units import ExposureUnit, GainUnit


@dataclass(frozen=True)
class ReadingOptions:
    """What the user says about a recording; None wherever its content shall tell.

    Attributes
    ----------
    channel
        Channel taken of colour images and Bayer mosaics; by default the luma of the first, the green pixels of the
        second.
    bayer
        Where the colours of a Bayer mosaic are.
    exposure_unit
        Unit of the exposures.
    gain_unit
        Unit of the gains.
    image_topic
        Topic of a bag with the images.
    exposure_topic
        Topic of a bag with the exposures.
    exposure_field
        Field of the messages on that topic that is the exposure, such as ``exposure_time``.
    gain_field
        Field of these messages that is a gain.
    unknown_exposures
        Whether recordings without usable exposures are opened, too; every frame's exposure is 1 ms then.
    """

    channel: Channel | None = None
    bayer: Mosaic | None = None
    exposure_unit: ExposureUnit | None = None
    gain_unit: GainUnit | None = None
    image_topic: str | None = None
    exposure_topic: str | None = None
    exposure_field: str | None = None
    gain_field: str | None = None
    unknown_exposures: bool = False


DEFAULT = ReadingOptions()
