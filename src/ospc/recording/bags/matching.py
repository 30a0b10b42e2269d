"""Which exposure belongs to which image of a bag: the one with the nearest time stamp."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ospc.arrays import IntArray
from ospc.errors import ExposureError, counted

_LEAST_SHARE = 0.5
"""Share of the images that must have an exposure; with fewer, the time stamps are wrong."""

_ONLY_IMAGE_TOLERANCE_NS = 5e8
"""How far an exposure may be from a single image, for which there is no frame interval."""


@dataclass(frozen=True)
class Times:
    """When messages were sent, 0 if they do not say, and when they were recorded, each of shape (messages,)."""

    stamp_ns: npt.NDArray[np.int64]
    log_ns: npt.NDArray[np.int64]


def match(images: Times, exposures: Times, source: str) -> tuple[IntArray, list[str]]:
    """Return the index of the exposure of every image, -1 for none, shape (images,), and notes for the user.

    Time stamps of the camera take precedence; if they are missing or come from different clocks, the times at which
    the messages were recorded are used. ExposureError if most images have no exposure.
    """
    ways = [("time of recording", images.log_ns, exposures.log_ns)]
    if np.all(images.stamp_ns > 0) and np.all(exposures.stamp_ns > 0):
        ways.insert(0, ("time stamp", images.stamp_ns, exposures.stamp_ns))
    for what, wanted, offered in ways:
        found, tolerance_ns = _nearest(wanted, offered)
        known = int(np.count_nonzero(found >= 0))
        if known >= _LEAST_SHARE * len(found):
            notes = [] if what == "time stamp" else [f"{source}: exposures are matched to images by {what}"]
            if known < len(found):
                notes.append(
                    f"{source}: {len(found) - known} of {counted(len(found), 'image')} left out, without exposure "
                    f"within {tolerance_ns / 1e6:.3g} ms"
                )
            return found, notes
    raise ExposureError(
        f"{source}: has an exposure for {known} of {counted(len(found), 'image')} only; record an exposure with the "
        f"time stamp of every image"
    )


def _nearest(wanted: npt.NDArray[np.int64], offered: npt.NDArray[np.int64]) -> tuple[IntArray, float]:
    """Return the index of the nearest time, -1 if it is further than half a frame interval, and this tolerance."""
    order = np.argsort(offered, kind="stable")
    times = offered[order]
    after = np.clip(np.searchsorted(times, wanted), 0, len(times) - 1)
    before = np.maximum(after - 1, 0)
    nearer = np.where(np.abs(times[after] - wanted) < np.abs(times[before] - wanted), after, before)
    steps = np.diff(np.sort(wanted))
    tolerance_ns = float(np.median(steps)) / 2 if len(steps) else _ONLY_IMAGE_TOLERANCE_NS
    found = np.where(np.abs(times[nearer] - wanted) <= tolerance_ns, order[nearer], -1)
    return found.astype(np.int64), tolerance_ns
