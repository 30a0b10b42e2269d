"""Which exposure belongs to which image of a bag: the one with its time stamp, or the nearest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ospc.arrays import IntArray
from ospc.errors import ExposureError

_LEAST_SHARE = 0.5
"""Of the images an exposure must be found for; with fewer something is wrong with the time stamps."""


@dataclass(frozen=True)
class Matching:
    """Exposures of images.

    Attributes
    ----------
    exposure
        Index of the exposure of every image, -1 where there is none, shape (images,).
    notes
        What was done, for the user.
    """

    exposure: IntArray
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Times:
    """When messages were sent and recorded.

    Attributes
    ----------
    stamp_ns
        Time stamps in the messages, 0 where there is none, shape (messages,).
    log_ns
        When they were recorded, shape (messages,).
    """

    stamp_ns: npt.NDArray[np.int64]
    log_ns: npt.NDArray[np.int64]

    @property
    def stamped(self) -> bool:
        """Whether all messages have a time stamp of their own."""
        return bool(np.all(self.stamp_ns > 0))


def match(images: Times, exposures: Times, source: str) -> Matching:
    """Find the exposure of every image.

    Time stamps of the camera come first; where they are missing, or belong to different clocks, the times at which
    the messages were recorded have to do.

    Parameters
    ----------
    images, exposures
        When they were sent and recorded.
    source
        What to call the exposures in a message.

    Raises
    ------
    ExposureError
        If there is no exposure for most images.
    """
    ways = []
    if images.stamped and exposures.stamped:
        ways.append(("time stamp", images.stamp_ns, exposures.stamp_ns))
    ways.append(("time of recording", images.log_ns, exposures.log_ns))
    for what, wanted, offered in ways:
        found, tolerance_ns = _nearest(wanted, offered)
        known = int(np.count_nonzero(found >= 0))
        if known >= _LEAST_SHARE * len(found):
            notes = [] if what == "time stamp" else [f"{source}: exposures are matched to images by {what}"]
            if known < len(found):
                notes.append(
                    f"{source}: {len(found) - known} of {len(found)} images have no exposure within "
                    f"{tolerance_ns / 1e6:.3g} ms and are left out"
                )
            return Matching(found, tuple(notes))
    raise ExposureError(
        f"{source}: has an exposure for {known} of {len(found)} images only; an exposure must be recorded with every "
        f"image, with its time stamp"
    )


def _nearest(wanted: npt.NDArray[np.int64], offered: npt.NDArray[np.int64]) -> tuple[IntArray, float]:
    """Return the index of the nearest time, -1 where it is farther than half the time between images."""
    order = np.argsort(offered, kind="stable")
    times = offered[order]
    after = np.clip(np.searchsorted(times, wanted), 0, len(times) - 1)
    before = np.maximum(after - 1, 0)
    nearer = np.where(np.abs(times[after] - wanted) < np.abs(times[before] - wanted), after, before)
    steps = np.diff(np.sort(wanted))
    tolerance_ns = float(np.median(steps)) / 2 if len(steps) else 5e8
    found = np.where(np.abs(times[nearer] - wanted) <= tolerance_ns, order[nearer], -1)
    return found.astype(np.int64), tolerance_ns
