"""The calibrator: frames in as they arrive, a calibration out at any moment."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from ospc.arrays import Image, ImageSize
from ospc.errors import ExposureError, FormatError, FrameError, OspcError, SettingError
from ospc.exposures.lookup import StatedExposures
from ospc.methods.maximum_likelihood import MaximumLikelihoodMethod
from ospc.methods.maximum_likelihood_state import MaximumLikelihoodState
from ospc.methods.method import Method, Progress
from ospc.methods.paper import PaperMethod
from ospc.methods.preview import Preview
from ospc.photometry.calibration import Calibration
from ospc.pooling.prior_calibration import PriorCalibration
from ospc.pooling.summary import Summary, summary_of
from ospc.recording import Frame, Recording, open_recording
from ospc.recording.ahead import decoded_ahead
from ospc.recording.identity import identity
from ospc.recording.stream import Item, frames_of
from ospc.settings import DefaultSettings, Settings, as_dict, preset, with_overrides
from ospc.state.run import RunState, load_run, save_run
from ospc.versions import versions


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

    Attributes
    ----------
    source
        Identification of the recording the frames are of, kept with states; empty for a live camera.
    saved_by
        Versions of the software that saved the state it goes on from; empty if it began anew.
    earlier
        What was known of the camera before, which calibrations start from as long as it agrees with the frames;
        None for nothing. It is not kept with states.

    Examples
    --------
    >>> calibrator = OnlineCalibrator()
    >>> for frame in open_recording("recording"):  # doctest: +SKIP
    ...     calibrator.push(frame)
    >>> calibrator.calibration().save("calibration.json")  # doctest: +SKIP
    """

    REMEMBERED = 20
    _FIRST_REASONS = 3
    _RECOGNISED_BY = 4

    def __init__(self, settings: Settings | str = "default") -> None:
        self._settings = preset(settings) if isinstance(settings, str) else settings
        self._method: Method | None = None
        self._size: ImageSize = (0, 0)
        self._frames = 0
        self._skipped = 0
        self._reasons: list[str] = []
        self._first_reasons: list[str] = []
        self._first_frames = ("", 0)
        self.source: dict[str, Any] = {}
        self.saved_by: dict[str, Any] = {}
        self.earlier: PriorCalibration | None = None

    def push(self, frame: Frame) -> bool:
        """Take the next frame and return whether it could be used.

        A frame that cannot be read, or whose size or exposure is wrong, is skipped and counted; the run goes on.
        """
        self._frames += 1
        try:
            self._check(frame)
            method = self._method_for(frame)
            method.push(replace(frame, load=partial(_of_size, frame, self._size)))
            self._recognise(frame)
        except (FrameError, ExposureError) as error:
            self._skip(str(error))
            return False
        return True

    def foresees(self, places: int) -> bool:
        """Whether the image of the frame so many places on (1 for the next) will most likely be looked at."""
        method = self._method
        return method.foresees(places) if isinstance(method, MaximumLikelihoodMethod) else True

    @property
    def status(self) -> Status:
        """Where the run stands; cheap enough to ask for after every frame."""
        progress = self._method.progress if self._method else Progress()
        return Status(self._frames, tuple(self._reasons), progress)

    def preview(self) -> Preview | None:
        """Return quick estimates and what they rest on, to be watched during a run; None before there are any.

        Preset "paper" has none before its end.
        """
        return self._method.preview() if isinstance(self._method, MaximumLikelihoodMethod) else None

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
        known = replace(known, counts=counts, settings=as_dict(self._settings), versions=versions())
        return known if self.earlier is None else self.earlier.continued(known, self.summary())

    # States.

    @property
    def frames(self) -> int:
        """Frames pushed so far, skipped ones included; the index of the next where every frame is pushed."""
        return self._frames

    @property
    def settings(self) -> Settings:
        """Settings of the method."""
        return self._settings

    @property
    def has_state(self) -> bool:
        """Whether its state can be saved; that of preset "paper" cannot."""
        return isinstance(self._settings, DefaultSettings) and isinstance(
            self._method, MaximumLikelihoodMethod | None
        )

    @property
    def first_reasons(self) -> tuple[str, ...]:
        """Why the first frames that could not be used were skipped, at most three of them."""
        return tuple(self._first_reasons)

    def save_state(self, path: str | Path, *, complete: bool = False) -> Path:
        """Write everything that is known to a file, whole or not at all, and return its path.

        Nothing here is changed by it: the result is the same whether states are saved or not.

        Parameters
        ----------
        path
            Where to; an earlier file is replaced.
        complete
            Whether to add the summary by which ``ospc merge`` reads it fast; costs a fit, unless
            :meth:`calibration` was asked for since the last frame.

        Raises
        ------
        SettingError
            If the method is one whose state is too large for that: preset "paper".
        FormatError
            If the file cannot be written.
        """
        if not self.has_state:
            raise SettingError(
                f"preset {self._settings.name} holds the features of hundreds of frames, which no state file takes; "
                "use the default preset"
            )
        method = self._method if isinstance(self._method, MaximumLikelihoodMethod) else None
        run = RunState(
            settings=as_dict(self._settings),
            size=self._size,
            max_grey=0 if method is None else method.max_grey,
            frames=self._frames,
            skipped=self._skipped,
            reasons=self._reasons,
            first_reasons=self._first_reasons,
            first_frames=self._first_frames,
            source=self.source,
            versions=versions(),
        )
        return save_run(path, run, None if method is None else method.state(), self.summary() if complete else None)

    def summary(self) -> Summary | None:
        """Return what is known as a value that can be merged with others; None where nothing is."""
        if not isinstance(self._method, MaximumLikelihoodMethod):
            return None
        return summary_of(self._method.evidence(), self._first_frames[0], self.source, self._frames)

    @classmethod
    def load_state(cls, path: str | Path) -> OnlineCalibrator:
        """Return a calibrator that goes on where another was when :meth:`save_state` wrote the file.

        Give it the frames it :attr:`wants <wanted>` by :meth:`recall` before the next is pushed, as
        :func:`remaining` does, and results are the same, bit for bit, as without the interruption. Where these
        frames are gone, it goes on without: the first new frames then have no earlier ones to be compared with.

        Raises
        ------
        FormatError
            If there is no such file, it is torn or damaged, or another version wrote it.
        """
        saved = load_run(path)
        run, method = saved.run, saved.method(MaximumLikelihoodState)
        settings = _settings_of(run.settings, saved.name)
        calibrator = cls(settings)
        calibrator._size, calibrator._frames, calibrator._skipped = run.size, run.frames, run.skipped
        calibrator._reasons, calibrator._first_reasons = run.reasons, run.first_reasons
        calibrator._first_frames, calibrator.source = run.first_frames, run.source
        calibrator.saved_by = run.versions
        if method is not None:
            try:
                calibrator._method = MaximumLikelihoodMethod.from_state(settings, run.size, run.max_grey, method)
            except ValueError as error:
                raise FormatError(f"{saved.name}: not readable as a state ({error})") from None
        return calibrator

    @property
    def wanted(self) -> frozenset[int]:
        """Indices of the frames that a calibrator just loaded should be shown again."""
        return self._method.wanted if isinstance(self._method, MaximumLikelihoodMethod) else frozenset()

    def recall(self, frame: Frame) -> None:
        """Look again at a frame that new ones were being compared with.

        Raises
        ------
        FrameError
            If its image cannot be read any more, or has another size.
        """
        if isinstance(self._method, MaximumLikelihoodMethod):
            self._method.recall(replace(frame, load=partial(_of_size, frame, self._size)))

    def _recognise(self, frame: Frame) -> None:
        """Take the first frames into the hash that tells this stream of frames from others."""
        digest, count = self._first_frames
        if count < self._RECOGNISED_BY:
            seen = f"{digest} {frame.stamp_s!r} {frame.exposure_ms!r} ".encode() + frame.image.tobytes()
            self._first_frames = (sha256(seen).hexdigest(), count + 1)

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
            method = self._settings.build((width, height), frame.max_grey)
            self._method = _AsStated(method) if isinstance(method, PaperMethod) else method
            self._size = (width, height)
        return self._method

    def _skip(self, reason: str) -> None:
        self._skipped += 1
        self._reasons = [*self._reasons, reason][-self.REMEMBERED :]
        self._first_reasons = [*self._first_reasons, reason][: self._FIRST_REASONS]


class _AsStated:
    """The paper's method with the exposures that frames state."""

    def __init__(self, method: PaperMethod) -> None:
        self._method = method
        self._exposures = StatedExposures()

    def push(self, frame: Frame) -> None:
        self._exposures.add(frame.index, frame.exposure_ms)
        self._method.push(frame, self._exposures)

    @property
    def progress(self) -> Progress:
        return self._method.progress

    def calibration(self) -> Calibration:
        return self._method.calibration(self._exposures)


def _of_size(frame: Frame, size: ImageSize) -> Image:
    """Return a frame's image, or say that it has another size than the first."""
    height, width = frame.image.shape
    if (width, height) != size:
        raise FrameError(
            f"{frame.name}: {width}×{height} pixels, but the first frame has {size[0]}×{size[1]}; "
            "calibrate each image size on its own"
        )
    return frame.image


def _settings_of(content: dict[str, Any], name: str) -> DefaultSettings:
    try:
        values = {key: str(value) for key, value in content.items() if key != "preset"}
        settings = with_overrides(preset(str(content.get("preset"))), values)
    except SettingError as error:
        raise FormatError(f"{name}: was made by another version of this program ({error})") from None
    if not isinstance(settings, DefaultSettings):
        raise FormatError(f"{name}: is of preset {settings.name}, which has no state")
    return settings


def remaining(calibrator: OnlineCalibrator, recording: Iterable[Frame]) -> Iterator[Frame]:
    """Give the frames of a recording that a calibrator was not pushed yet, after showing it those it asks for.

    Parameters
    ----------
    calibrator
        New, or loaded from a state of a run over the same recording.
    recording
        All frames from the first on.

    Raises
    ------
    FrameError
        If a frame that had been read before cannot be read any more.
    """
    wanted, done = calibrator.wanted, calibrator.frames
    for number, frame in enumerate(recording):
        if number >= done:
            yield frame
        elif frame.index in wanted:
            calibrator.recall(frame)


def calibrate(
    recording: Recording | str | Path | Iterable[Item],
    settings: Settings | str = "default",
    *,
    progress: Callable[[Status], None] | None = None,
) -> Calibration:
    """Calibrate the camera of a recording.

    Parameters
    ----------
    recording
        A recording, the path of one, or any iterable of frames or of (image, exposure in ms).
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
        frames = source if isinstance(source, Recording) else frames_of(source)
        for frame in decoded_ahead(frames, calibrator.foresees):
            calibrator.push(frame)
            if progress is not None:
                progress(calibrator.status)
    except KeyboardInterrupt:
        interrupted = True
    origin = identity(source) if isinstance(source, Recording) else {"kind": "stream"}
    return replace(calibrator.calibration(), partial=interrupted, source=origin)
