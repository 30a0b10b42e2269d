"""A guided capture: feeds frames to a live calibrator and provides what its page shows."""

from __future__ import annotations

import math
import threading
import time
from array import array
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass
from typing import Any, Literal

import cv2
import numpy as np

from ospc.arrays import FloatArray, IntArray
from ospc.errors import FrameError
from ospc.formats.image_files import encoded
from ospc.live.advice import Instruction
from ospc.live.calibrator import LiveCalibrator, in_memory, with_safe_load
from ospc.methods.preview import Preview
from ospc.photometry.calibration import PROFILE_RADII
from ospc.photometry.geometry import half_diagonal
from ospc.photometry.vignette import diagonal_profile
from ospc.recording import Frame
from ospc.settings.live import GOAL, LONGEST_GAP_S

Stage = Literal["filming", "estimating", "writing", "written", "failed"]

WAITING_FRAMES = 4
"""Frames of a recording that may be queued: few, so that the page shows what is being calibrated."""

_PICTURE_PX, _JPEG = 640, 80
"""Longest side and JPEG quality of the picture on the page."""

_COVERED = 150
"""Observations that fill a bin of grey levels, radii or image cells: five times the number below which the report
reports a gap."""

_GREYS, _RADII = slice(1, -2), slice(0, -1)
"""Bins that can be filled: in the others, nearly everything is clipped or lies outside the image."""

_WIDE_RANGE, _NOTHING_KNOWN, _UNCONFIRMED = 8.0, 0.2, 0.97
"""Exposure ratio at which the exposure bar is full, standard deviation at which the certainty bar is empty, and the
most that the certainty bar shows before a complete estimate has confirmed the quick ones."""

_COLUMNS, _ROWS = 16, 12
"""Cells of the image in which observations are counted for the overlay on the picture."""

_CURVE_POINTS = 51
"""Points of the response curve, as many as in the vignette profile."""


@dataclass(frozen=True)
class Bars:
    """Levels of the progress bars, each from 0 to 1.

    ``exposures`` is the range of the exposures, and ``certainty`` shows how close the uncertainty is to the goal,
    both on a logarithmic scale. ``greys`` and ``radii`` are the shares of grey levels and radii with enough
    observations.
    """

    exposures: float = 0.0
    greys: float = 0.0
    radii: float = 0.0
    certainty: float = 0.0

    @classmethod
    def of(cls, preview: Preview | None, instruction: Instruction, goal: float = GOAL) -> Bars:
        """Return the bars for a preview and the current instruction."""
        if preview is None:
            return cls()
        low, high = preview.coverage.exposure_edges_ms[[0, -1]]
        sigmas = (instruction.response_sigma, instruction.vignette_sigma)
        known = [sigma for sigma in sigmas if sigma is not None]
        certainty = 1.0 if instruction.kind == "done" else 0.0
        if len(known) == len(sigmas) and not certainty:
            least = min(goal, _NOTHING_KNOWN / 2)
            reached = np.log(_NOTHING_KNOWN / max(*known, least)) / np.log(_NOTHING_KNOWN / least)
            certainty = min(float(reached), _UNCONFIRMED)
        return cls(
            min(float(np.log(high / low) / np.log(_WIDE_RANGE)), 1.0),
            _share(preview.coverage.by_grey[_GREYS]),
            _share(preview.coverage.by_radius[_RADII]),
            max(certainty, 0.0),
        )


class Capture:
    """Feeds a live calibrator, and reports its progress to any thread.

    With ``ends``, the capture ends on its own when the calibrator's goal is reached. ``out`` is the name of the
    output folder, shown on the page. ``stage`` and ``message`` describe the current activity or the outcome.
    """

    def __init__(self, live: LiveCalibrator, *, ends: bool = True, out: str = "") -> None:
        self.live = live
        self.stage: Stage = "filming"
        self.message = ""
        self._ends = ends
        self._out = out
        self._stamps_s, self._exposures_ms = array("d"), array("d")  # compact: a capture may be long
        self._shown: Frame | None = None
        self._viewed = threading.Event()
        self._viewed.set()  # so that the first frame is kept for the first viewer
        self._finish = threading.Event()
        self._begun_s = time.monotonic()

    @property
    def stamps_s(self) -> FloatArray:
        """Time stamp in seconds of every frame, shape (frames,)."""
        return np.array(self._stamps_s)

    @property
    def exposures_ms(self) -> FloatArray:
        """Exposure in milliseconds of every frame, shape (frames,)."""
        return np.array(self._exposures_ms)

    def run(self, frames: Iterable[Frame], stop: Callable[[], bool], *, replayed: bool) -> None:
        """Push frames until they end, the goal is reached, or the capture is stopped.

        ``stop`` is called after every frame, and ends the capture if it returns True. Frames ``replayed`` from a
        recording wait for the background thread, so that none is dropped.
        """
        for frame in frames:
            self._show(frame)
            self._stamps_s.append(frame.stamp_s)
            self._exposures_ms.append(frame.exposure_ms)
            self.live.push(frame)
            if replayed:
                self.live.wait(WAITING_FRAMES)
            done = self._ends and self.live.status.instruction.kind == "done"
            if stop() or self._finish.is_set() or done:
                break

    def _show(self, frame: Frame) -> None:
        """Show a frame; one that only this thread can read is copied, but only if the previous one was viewed."""
        safe = with_safe_load(frame)
        if frame.threads:
            self._shown = safe
        elif self._viewed.is_set():
            self._viewed.clear()
            try:
                self._shown = in_memory(safe)
            except FrameError:
                self._shown = None

    def finish(self) -> None:
        """Request the end of the capture."""
        self._finish.set()

    @property
    def bars(self) -> Bars:
        """Current levels of the progress bars."""
        return Bars.of(self.live.preview, self.live.status.instruction, self.live.goal)

    def view(self) -> dict[str, Any]:
        """Return everything that the page shows except the picture, as JSON-compatible values."""
        status, preview = self.live.status, self.live.preview
        return {
            "stage": self.stage,
            "message": self.message,
            "out": self._out,
            "goal": self.live.goal,
            "seconds": round(time.monotonic() - self._begun_s, 1),
            "frames": status.frames,
            "dropped": status.dropped,
            "unusable": status.unusable,
            "notes": list(status.notes),
            "instruction": asdict(status.instruction),
            "bars": asdict(Bars.of(preview, status.instruction, self.live.goal)),
            **({} if preview is None else _seen(preview)),
        }

    def picture(self) -> bytes | None:
        """Return the latest frame as a reduced JPEG; None if there is no readable one.

        If only the capturing thread can read the frames, it is the first frame after the previous call.
        """
        self._viewed.set()
        frame = self._shown
        if frame is None:
            return None
        try:
            image = frame.image_8_bit
        except FrameError:
            return None
        scale = min(1.0, _PICTURE_PX / max(image.shape))
        if scale < 1:
            image = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        return encoded(image, ".jpg", frame.name, jpeg_quality=_JPEG)


def replayed(frames: Iterable[Frame], pace: float) -> Iterator[Frame]:
    """Yield the frames of a recording at the pace of their stamps times ``pace``; 0 for no waiting.

    Gaps between stamps, as after the clock was set, are shortened to :data:`~ospc.settings.live.LONGEST_GAP_S`.
    """
    due_s, before_s = time.monotonic(), math.inf
    for frame in frames:
        if pace > 0:
            due_s += min(max(frame.stamp_s - before_s, 0.0), LONGEST_GAP_S) / pace
            before_s = frame.stamp_s
            time.sleep(max(0.0, due_s - time.monotonic()))
        yield frame


def _seen(preview: Preview) -> dict[str, Any]:
    """Return the coverage of image cells, grey levels and radii, and the curves with their standard deviations."""
    found: dict[str, Any] = {
        "greys": _filled(preview.coverage.by_grey),
        "radii": _filled(preview.coverage.by_radius),
        "exposures_ms": preview.coverage.exposure_edges_ms[[0, -1]].tolist(),
    }
    if preview.fit is not None:
        found["places"] = _places(preview.observations.position, preview.size)
    if preview.response is not None and preview.vignette is not None and preview.vignette_sigma is not None:
        grey = np.linspace(0, 1, _CURVE_POINTS)
        sigma = preview.response.inverse_sigma
        spread = np.zeros_like(grey) if sigma is None else np.interp(grey, preview.response.levels, sigma)
        found["response"] = _curve(preview.response.inverse(grey), spread)
        found["vignette"] = _curve(diagonal_profile(preview.vignette, PROFILE_RADII), preview.vignette_sigma)
    return found


def _places(position: FloatArray, size: tuple[int, int]) -> list[list[float]]:
    shares = position * half_diagonal(size) / np.array(size) + 0.5
    x, y = np.clip(shares, 0, 1).T
    counts, _, _ = np.histogram2d(y, x, (_ROWS, _COLUMNS), ((0, 1), (0, 1)))
    return [_filled(row) for row in counts]


def _curve(value: FloatArray, sigma: FloatArray) -> dict[str, list[float]]:
    return {"value": np.round(value, 5).tolist(), "sigma": np.round(sigma, 5).tolist()}


def _filled(counts: IntArray) -> list[float]:
    """Return how full the bins are, from 0 to 1."""
    return [round(min(count / _COVERED, 1.0), 2) for count in counts.tolist()]


def _share(counts: IntArray) -> float:
    return float(np.mean(np.minimum(counts / _COVERED, 1.0)))
