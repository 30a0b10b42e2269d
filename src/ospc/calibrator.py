"""Calibration from Python: frame by frame, or a whole recording at once."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

from ospc.engine.engine import Engine, Status
from ospc.engine.state import Run
from ospc.engine.state_rules import check_run
from ospc.errors import FormatError, OspcError, SettingError
from ospc.exposures.findings import ExposureFindings
from ospc.exposures.lag_choice import LagChoice, check_lag, checked_lag_choice, lag_choice_for
from ospc.exposures.monitor import ExposureMonitor
from ospc.exposures.used import with_earlier_exposures
from ospc.methods.fit_inputs import FitInputs
from ospc.methods.preview import Preview
from ospc.photometry.calibration import Calibration
from ospc.pooling.prior_calibration import PriorCalibration
from ospc.pooling.summary import Summary
from ospc.recording import Frame, Recording, open_recording
from ospc.recording.recording import identity
from ospc.recording.stream import Item, decoded_ahead, frames_of
from ospc.settings import Settings, as_dict, preset, with_overrides
from ospc.state.run import load_run, save_run
from ospc.system.library_threads import one_library_thread
from ospc.system.versions import versions

__all__ = ["OnlineCalibrator", "Status", "calibrate", "drive", "remaining"]


class OnlineCalibrator(Engine):
    """Calibrates a camera frame by frame. The calibration is available at any time, and the state can be saved.

    Memory is bounded, except for the exposure of every frame and a few hundred bytes for every change of the camera.
    Frames are numbered in the order in which they are pushed. All methods are thread-safe.

    Parameters
    ----------
    settings
        Settings of the method, or the name of a preset.
    correct_lag
        What to do if exposures are recorded with the wrong frames: correct the lag if it is certain (``"auto"``),
        never correct it (``"never"``), or correct it by this many frames, positive if exposures are late.
    prior
        An earlier calibration of the camera. It is used as a prior as long as it agrees with the frames, and the
        camera does not change.

    Raises
    ------
    SettingError
        If a parameter is invalid, or the method cannot use an earlier calibration.

    Examples
    --------
    >>> calibrator = OnlineCalibrator()
    >>> for frame in open_recording("recording"):  # doctest: +SKIP
    ...     calibrator.push(frame)
    >>> calibrator.calibration().save("calibration.json")  # doctest: +SKIP
    """

    def __init__(
        self,
        settings: Settings | str = "default",
        *,
        correct_lag: LagChoice = "auto",
        prior: PriorCalibration | None = None,
    ) -> None:
        made = preset(settings) if isinstance(settings, str) else settings
        if isinstance(made, type) or not hasattr(made, "sampler"):
            raise SettingError(
                f"settings are of type {type(settings).__name__}; give the name of a preset, or settings such as "
                "DefaultSettings(max_points=5000); images and exposures are passed as pairs: zip(images, exposures)"
            )
        if prior is not None:
            _check_prior(prior, made)
        exposures = ExposureMonitor(correct_lag)
        super().__init__(made, Run(settings=as_dict(made), exposures=exposures, sampler=made.sampler()))
        self.prior = prior

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

    def calibration(self) -> Calibration:
        """Return the calibration from the frames so far; more may be pushed later. OspcError if none was usable."""
        with self._lock:
            run, method = self._run, self._method
            if method is None:
                why = f": {run.skipped.latest[-1]}" if run.skipped.latest else ""
                raise OspcError(f"no frame could be used{why}")
            exposures, found, grey_range = run.used_before(run.frames, method)
            known = self._with_earlier(method, exposures, grey_range)
            result = run.judged(known, found, {"frames": run.frames, "skipped": run.skipped.count})
            ended = ((e.last_frame + 1, e.corrected_lag_frames, e.wrong_exposures) for e in run.epochs)
            return replace(result, source=with_earlier_exposures(run.source | result.source, ended))

    def exposure_findings(self) -> ExposureFindings:
        """Return the findings about the exposures so far; OspcError if no frame was usable."""
        with self._lock:
            if self._method is None:
                raise OspcError("no frame could be used, so the exposures could not be checked")
            return self._run.used_before(self.frames, self._method)[1]

    def inputs(self) -> FitInputs | None:
        """Return the inputs of the fit of response and vignette; None if nothing can be merged."""
        with self._lock:
            if self._method is None:
                return None
            exposures, _, grey_range = self._run.used_before(self.frames, self._method)
            return self._method.inputs(exposures, grey_range)

    def summary(self) -> Summary | None:
        """Return a summary that can be merged with others; None if there is nothing to merge."""
        with self._lock:
            return self._summary_of(self.inputs())

    def preview(self) -> Preview | None:
        """Return quick estimates and the data behind them, for display during a run; None before there are any."""
        with self._lock:
            return None if self._method is None else self._method.preview(self._run.exposures.table)

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
            run = replace(self._run, exposures=self._run.exposures.trimmed(), versions=versions())
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
        run, method = load_run(path, Run, lambda run: _settings_of(run.settings, str(path)).state_type())
        settings = _settings_of(run.settings, str(path))
        try:
            check_run(run, method, settings)
            calibrator = cls(settings)
            calibrator._restore(run, method)
        except (FormatError, SettingError, LookupError, TypeError, ValueError, AttributeError) as error:
            raise FormatError(f"{path}: not readable as a state ({error})") from None
        return calibrator

    def __getstate__(self) -> NoReturn:
        """Refuse to be pickled or copied."""
        raise OspcError(
            "a calibrator cannot be pickled or copied; save it with save_state, and load it with "
            "OnlineCalibrator.load_state"
        )


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

    def wanted(places: int) -> bool:
        return calibrator.will_need_image(calibrator.frames + places - 1)

    with one_library_thread():
        for frame in decoded_ahead(remaining(calibrator, frames), wanted):
            used = calibrator.push(frame)
            if after_frame is not None:
                after_frame(frame, used)


def _check_prior(prior: object, settings: Settings) -> None:
    if not isinstance(prior, PriorCalibration):
        raise SettingError(f"prior is of type {type(prior).__name__}; give PriorCalibration.open(path)")
    prior.check_method(settings)


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
