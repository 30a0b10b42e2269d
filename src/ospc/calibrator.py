"""The calibrator: frames in as they arrive, a calibration out at any moment."""

from __future__ import annotations

import platform
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import scipy

import ospc
from ospc.arrays import Image, ImageSize
from ospc.errors import ExposureError, FrameError, OspcError
from ospc.methods.method import Method, Progress
from ospc.photometry.calibration import Calibration
from ospc.presets import Settings, as_dict, preset
from ospc.recording import Frame, Recording, open_recording
from ospc.recording.identity import identity


@dataclass(frozen=True)
class Status:
    """Where a run over a recording stands.

    Attributes
    ----------
    frames
        Frames pushed so far, skipped ones included.
    skipped
        Why frames were skipped, the most recent last, at most :data:`OnlineCalibrator.REMEMBERED` of them.
    progress
        The method's own figures.
    """

    frames: int
    skipped: tuple[str, ...]
    progress: Progress


class OnlineCalibrator:
    """Calibrates a camera from its frames, one by one, in bounded memory.

    Parameters
    ----------
    settings
        Settings of the method, or the name of a preset.

    Examples
    --------
    >>> calibrator = OnlineCalibrator()
    >>> for frame in open_recording("recording"):  # doctest: +SKIP
    ...     calibrator.push(frame)
    >>> calibrator.calibration().save("calibration.json")  # doctest: +SKIP
    """

    REMEMBERED = 20

    def __init__(self, settings: Settings | str = "default") -> None:
        self._settings = preset(settings) if isinstance(settings, str) else settings
        self._method: Method | None = None
        self._size: ImageSize = (0, 0)
        self._frames = 0
        self._skipped = 0
        self._reasons: list[str] = []

    def push(self, frame: Frame) -> bool:
        """Take the next frame and return whether it could be used.

        A frame that cannot be read, or whose size or exposure is wrong, is skipped and counted; the run goes on.
        """
        self._frames += 1
        try:
            self._check(frame)
            method = self._method_for(frame)
            method.push(replace(frame, load=partial(_of_size, frame, self._size)))
        except (FrameError, ExposureError) as error:
            self._skip(str(error))
            return False
        return True

    @property
    def status(self) -> Status:
        """Where the run stands; cheap enough to ask for after every frame."""
        progress = self._method.progress if self._method else Progress()
        return Status(self._frames, tuple(self._reasons), progress)

    def calibration(self) -> Calibration:
        """Return what is known now; pushing may go on afterwards.

        Raises
        ------
        OspcError
            If no frame could be read so far.
        """
        if self._method is None:
            why = f": {self._reasons[-1]}" if self._reasons else ""
            raise OspcError(f"no frame could be used{why}")
        known = self._method.calibration()
        counts = {"frames": self._frames, "skipped": self._skipped, **known.counts}
        return replace(known, counts=counts, settings=as_dict(self._settings), versions=versions())

    def _check(self, frame: Frame) -> None:
        if not (np.isfinite(frame.exposure_ms) and frame.exposure_ms > 0):
            raise ExposureError(f"{frame.name}: exposure {frame.exposure_ms} ms is not a positive number")
        # Most frames need not be decoded; that one is missing or cut off is found out nevertheless.
        if frame.verify is not None:
            frame.verify()
        elif self._method is not None:
            _of_size(frame, self._size)

    def _method_for(self, frame: Frame) -> Method:
        if self._method is None:
            height, width = frame.image.shape
            self._method = self._settings.build((width, height), frame.max_grey)
            self._size = (width, height)
        return self._method

    def _skip(self, reason: str) -> None:
        self._skipped += 1
        self._reasons = [*self._reasons, reason][-self.REMEMBERED :]


def _of_size(frame: Frame, size: ImageSize) -> Image:
    """Return a frame's image, or say that it has another size than the first."""
    height, width = frame.image.shape
    if (width, height) != size:
        raise FrameError(
            f"{frame.name}: {width}×{height} pixels, but the first frame has {size[0]}×{size[1]}; "
            "calibrate each image size on its own"
        )
    return frame.image


def calibrate(
    recording: Recording | str | Path,
    settings: Settings | str = "default",
    *,
    progress: Callable[[Status], None] | None = None,
) -> Calibration:
    """Calibrate the camera of a recording.

    Parameters
    ----------
    recording
        A recording, or the path of one.
    settings
        Settings of the method, or the name of a preset.
    progress
        Called after every frame. It may raise ``KeyboardInterrupt`` (as Ctrl-C does at any time): the calibration
        from the frames up to then is returned, marked partial.

    Returns
    -------
    Calibration
        Its ``verdicts`` say what could be known. Parts that could not are None.

    Raises
    ------
    RecordingError
        If the recording cannot be opened.
    OspcError
        If none of its frames can be used.
    """
    source = open_recording(recording) if isinstance(recording, str | Path) else recording
    calibrator = OnlineCalibrator(settings)
    interrupted = False
    try:
        for frame in source:
            calibrator.push(frame)
            if progress is not None:
                progress(calibrator.status)
    except KeyboardInterrupt:
        interrupted = True
    return replace(calibrator.calibration(), partial=interrupted, source=identity(source))


def versions() -> dict[str, str]:
    """Return the versions of everything a result depends on."""
    return {
        "ospc": ospc.__version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "opencv": cv2.__version__,
    }
