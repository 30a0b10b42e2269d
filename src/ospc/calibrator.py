"""Calibration from Python: frame by frame, or a whole recording at once."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from ospc.engine.engine import Engine, Status
from ospc.engine.frame_checks import image_of_size
from ospc.engine.state import EngineState
from ospc.engine.state_fields import check_fields
from ospc.engine.state_rules import check_run
from ospc.errors import FormatError, FrameError, SettingError
from ospc.exposures.lag_choice import LagChoice, check_lag, checked_lag_choice, lag_choice_for
from ospc.photometry.calibration import Calibration
from ospc.recording import Frame, Recording, open_recording
from ospc.recording.recording import identity
from ospc.recording.stream import Item, decoded_ahead, frames_of
from ospc.settings import Settings, as_dict, preset, with_overrides
from ospc.state.run import load_run, save_run
from ospc.system.library_threads import one_library_thread
from ospc.system.versions import versions

__all__ = ["OnlineCalibrator", "Status", "calibrate", "drive", "remaining"]


class OnlineCalibrator(Engine):
    """Calibrates a camera frame by frame. Its state can be saved to a file and loaded again.

    Examples
    --------
    >>> calibrator = OnlineCalibrator()
    >>> for frame in open_recording("recording"):  # doctest: +SKIP
    ...     calibrator.push(frame)
    >>> calibrator.calibration().save("calibration.json")  # doctest: +SKIP
    """

    @classmethod
    def of(
        cls,
        recording: Recording,
        settings: Settings | str = "default",
        *,
        correct_lag: LagChoice = "auto",
        source: dict[str, Any] | None = None,
    ) -> OnlineCalibrator:
        """Return a calibrator for a recording; some kinds of recording guarantee that exposures do not lag.

        ``source`` identifies the recording. By default, it is computed, for which a few images are read.

        Raises
        ------
        SettingError
            If ``correct_lag`` is invalid, or not smaller than the number of frames.
        """
        choice = checked_lag_choice(correct_lag)
        check_lag(choice, len(recording))
        calibrator = cls(settings, correct_lag=lag_choice_for(recording, choice))
        calibrator.source = identity(recording) if source is None else source
        return calibrator

    def save_state(self, path: str | Path, *, complete: bool = False) -> Path:
        """Write the state to a file atomically and return its path.

        Saving does not affect the result. ``complete`` adds the summary that ``ospc merge`` needs. It takes one fit,
        unless :meth:`calibration` was called since the last frame.

        Raises
        ------
        SettingError
            If the method has no state, as that of the preset "paper".
        FormatError
            If the file cannot be written, or an error such as running out of memory left a frame partly processed.
        """
        if self.settings.state_type() is None:
            raise SettingError(f"preset {self.settings.name} cannot be saved as a state; use the default preset")
        with self._lock:
            if self._partly_processed:
                raise FormatError(f"{path}: not written, because {self._partly_processed} was only partly processed")
            summary = self.summary() if complete else None
            method = None if self._method is None else self._method.state()
            run = EngineState(
                settings=as_dict(self.settings),
                size=self._size,
                max_grey=self._max_grey,
                exposures=self._exposures.trimmed(),
                sampler=self._sampler,
                pixels=self.pixels,
                epochs=self._epochs,
                skipped=self._skipped,
                first_frames=self._first_frames,
                source=self.source,
                versions=versions(),
            )
            return save_run(path, run, method, summary)

    @classmethod
    def load_state(cls, path: str | Path) -> OnlineCalibrator:
        """Return a calibrator that continues from the state :meth:`save_state` wrote.

        Pass its :attr:`frames_to_replay` to :meth:`replay` before pushing the next frame, as :func:`remaining` does.
        The results are then bit for bit the same as without the interruption. Without these frames the calibrator
        still works, but the first new frames cannot be compared with earlier ones.

        Raises
        ------
        FormatError
            If the file does not exist, is truncated or damaged, or was written by another version.
        """
        run, method = load_run(path, EngineState, lambda run: _settings_of(run.settings, str(path)).state_type())
        settings = _settings_of(run.settings, str(path))
        try:
            check_run(run, settings)
            calibrator = cls(settings)
            calibrator._restore(run, method)
        except (FormatError, SettingError, LookupError, TypeError, ValueError, AttributeError) as error:
            raise FormatError(f"{path}: not readable as a state ({error})") from None
        return calibrator

    def _restore(self, run: EngineState, method: object | None) -> None:
        """Continue from a state; FormatError or ValueError if its parts are inconsistent."""
        self._size, self._max_grey = run.size, run.max_grey
        self._sampler, self.pixels = run.sampler, run.pixels
        self._skipped, self._first_frames = run.skipped, run.first_frames
        self._epochs = run.epochs
        self._exposures = run.exposures
        if (run.max_grey == 0) != (method is None):
            raise FormatError("a run must have both a first frame and a method, or neither")
        if method is not None:
            check_fields(method)
            self._method = self.settings.build(run.size, run.max_grey)
            self._method.restore(method, self.frames)
        self.source, self.saved_by = run.source, run.versions
        self._update_prefetcher()

    @property
    def frames_to_replay(self) -> frozenset[int]:
        """Numbers of the frames that :meth:`replay` needs before a loaded calibrator continues."""
        with self._lock:
            if self._method is None:
                return frozenset()
            return self._method.frames_to_replay | self._exposures.history.frames_to_replay

    def replay(self, frame: Frame) -> None:
        """Process an earlier frame again, so that new frames can be compared with it.

        Its index is its number in the run, one of :attr:`frames_to_replay`.

        Raises
        ------
        FrameError
            If its number is not one of these, its image can no longer be read, or its size has changed.
        """
        with self._lock:
            if self._method is None or frame.index not in self.frames_to_replay:
                name = frame.name
                raise FrameError(f"{name}: is not one of frames_to_replay; set its index to its number in the run")
            shown = replace(frame, load=partial(image_of_size, frame, self._size))
            prepared = self._preprocess(shown, self.pixels.grey_range_before(frame.index))
            self._method.replay(prepared)
            self._exposures.history.replay(prepared.thumbnail)


def _settings_of(content: dict[str, Any], name: str) -> Settings:
    try:
        values = {key: str(value) for key, value in content.items() if key != "preset"}
        return with_overrides(preset(str(content.get("preset"))), values)
    except SettingError as error:
        raise FormatError(f"{name}: was written by another version of this program ({error})") from None


def remaining(calibrator: OnlineCalibrator, recording: Iterable[Frame]) -> Iterator[Frame]:
    """Yield the frames of a recording that a calibrator has not seen yet, after replaying those it needs.

    The calibrator is new, or was loaded from a state of a run over the same recording.

    Raises
    ------
    FrameError
        If a frame to replay can no longer be read.
    """
    replayed, done = calibrator.frames_to_replay, calibrator.frames
    for number, frame in enumerate(recording):
        if number >= done:
            yield frame
        elif number in replayed:
            calibrator.replay(replace(frame, index=number))


def drive(
    calibrator: OnlineCalibrator, frames: Iterable[Frame], after_frame: Callable[[Frame, bool], None] | None = None
) -> None:
    """Push all :func:`remaining` frames, decoded ahead by another thread. This is the only loop over frames.

    ``after_frame`` is called after each frame with the frame and whether it could be used. It may raise an exception
    to end the run early.
    """
    prefetcher = calibrator.prefetcher
    with one_library_thread():
        for frame in decoded_ahead(
            remaining(calibrator, frames),
            lambda places: prefetcher.needs(calibrator.frames + places - 1),
            lambda places: partial(prefetcher.prepare, calibrator.frames + places - 1),
        ):
            used = calibrator.push(frame)
            if after_frame is not None:
                after_frame(frame, used)


def calibrate(
    recording: Recording | str | Path | Iterable[Item],
    settings: Settings | str = "default",
    *,
    correct_lag: LagChoice = "auto",
    progress: Callable[[Status], None] | None = None,
) -> Calibration:
    """Calibrate the camera of a recording.

    Parameters
    ----------
    recording
        A recording, its path, or any iterable of frames or of (image, exposure in ms) tuples.
    settings
        Settings of the method, or the name of a preset.
    correct_lag
        What to do if exposures are recorded with the wrong frames: correct the lag if it is certain (``"auto"``),
        never correct it (``"never"``), or correct it by this many frames, positive if exposures are late.
    progress
        Called after every frame. If it raises ``KeyboardInterrupt``, as Ctrl-C does, the calibration from the frames
        so far is returned, marked as partial.

    Returns
    -------
    Calibration
        Its ``verdicts`` state which parts could be determined; the others are None.

    Raises
    ------
    RecordingError
        If the recording cannot be opened.
    SettingError
        If there is no such preset, or ``correct_lag`` is invalid or not smaller than the number of frames.
    OspcError
        If no frame can be used.
    """
    source = open_recording(recording) if isinstance(recording, str | Path) else recording
    if isinstance(source, Recording):
        calibrator = OnlineCalibrator.of(source, settings, correct_lag=correct_lag)
        frames: Iterable[Frame] = source
    else:
        calibrator, frames = OnlineCalibrator(settings, correct_lag=correct_lag), frames_of(source)
        calibrator.source = {"kind": "stream"}
    interrupted = False
    try:
        drive(calibrator, frames, None if progress is None else lambda _frame, _used: progress(calibrator.status))
    except KeyboardInterrupt:
        interrupted = True
    return replace(calibrator.calibration(), partial=interrupted)
