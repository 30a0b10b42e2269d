"""What a check of a parameter file finds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

from ospc.arrays import ImageSize

Program: TypeAlias = Literal["dso", "mono"]
"""``dso``: DSO and its descendants; ``mono``: the TUM monocular data set's own tools."""

Kind: TypeAlias = Literal["pcalib", "vignette", "times", "camera"]
"""The kinds of parameter files."""

Severity: TypeAlias = Literal["error", "warning", "note"]
"""``error``: the program refuses the file or computes nonsense with it; ``warning``: it takes it, but hardly as
meant; ``note``: worth knowing."""

UNCORRECTED = {
    "dso": "prints one line and runs on uncorrected images, while mode 0 believes that they are corrected",
    "mono": "prints one line and corrects neither response nor vignette",
}
"""What each program does without a response or vignette it accepts."""


@dataclass(frozen=True)
class Finding:
    """One thing that is to be said about a parameter file.

    Attributes
    ----------
    severity
        How bad it is.
    file
        Which file.
    rule
        The rule that was checked and what breaks it, with figures.
    effect
        What the program would do with the file.
    remedy
        What to do; empty where nothing is to be done.
    """

    severity: Severity
    file: str
    rule: str
    effect: str
    remedy: str = ""


@dataclass(frozen=True)
class Context:
    """What a check knows besides the file.

    Attributes
    ----------
    program
        Which program's rules apply.
    size
        Width and height of the images in pixels; None where unknown.
    images
        Number of images of the recording; None where unknown.
    """

    program: Program
    size: ImageSize | None = None
    images: int | None = None
