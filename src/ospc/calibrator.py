"""Calibrating from Python: frame by frame, or a whole recording at once."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from ospc.engine import Engine, Status
from ospc.engine_state import EngineState, epoch_content, epoch_of
from ospc.errors import FormatError, SettingError
from ospc.exposures.lag_choice import LagChoice, check_lag, checked_lag_choice, lag_choice, lag_choice_for
from ospc.frame_checks import image_of_size
from ospc.library_threads import one_library_thread
from ospc.methods.maximum_likelihood_state import MaximumLikelihoodState
from ospc.photometry.calibration import Calibration
from ospc.recording import Frame, Recording, open_recording
from ospc.recording.recording import identity
from ospc.recording.stream import Item, decoded_ahead, frames_of
from ospc.settings import DefaultSettings, Settings, as_dict, preset, with_overrides
from ospc.state.run import load_run, save_run
from ospc.state_rules import check_run
from ospc.versions import versions

__all__ = ["OnlineCalibrator", "Status", "calibrate", "drive", "remaining"]


class OnlineCalibrator(Engine):
    """Calibrates a camera from its frames, one by one, in bounded memory; its state can be kept in a file.

    Attributes
    ----------
    saved_by
        Versions of the software that saved the state it goes on from; empty if it began anew.

    Examples
    --------
    >>> calibrator = OnlineCalibrator()
    >>> for frame in open_recording("recording"):  # doctest: +SKIP
    ...     calibrator.push(frame)
    >>> calibrator.calibration().save("calibration.json")  # doctest: +SKIP
    """

    def __init__(self, settings: Settings | str = "default", *, correct_lag: LagChoice = "auto") -> None:
        super().__init__(settings, correct_lag=correct_lag)
        self.saved_by: dict[str, Any] = {}

    @classmethod
    def of(
        cls, recording: Recording, settings: Settings | str = "default", *, correct_lag: LagChoice = "auto"
    ) -> OnlineCalibrator:
        """Return a calibrator for the frames of a recording, whose kind may say that no exposure can be late.

        Raises
        ------
        SettingError
            If ``correct_lag`` is no choice, or leaves nothing of the frames.
        """
        choice = checked_lag_choice(correct_lag)
        check_lag(choice, len(recording))
        return cls(settings, correct_lag=lag_choice_for(recording.kind, choice))

    def save_state(self, path: str | Path, *, complete: bool = False) -> Path:
        """Write everything that is known to a file, whole or not at all, and return its path.

        Nothing here is changed by it: the result is the same whether states are saved or not. With ``complete``, the
        summary is added that ``ospc merge`` needs; it costs a fit, unless :meth:`calibration` was asked for since the
        last frame.

        Raises
        ------
        SettingError
            If the state of the method is too large for that: preset "paper".
        FormatError
            If the file cannot be written, or an error such as the end of memory left a frame half processed.
        """
        if self._partly_processed:
            raise FormatError(f"{path}: not written, for {self._partly_processed} was processed in part only")
        if not self.settings.keeps_state:
            raise SettingError(
                f"preset {self.settings.name} holds the features of hundreds of frames, which no state file takes; "
                "use the default preset"
            )
        with self._lock:
            summary = self.summary() if complete else None
            method = None if self._method is None else self._method.state()
            run = EngineState(
                settings=as_dict(self.settings),
                correct_lag=str(self.correct_lag),
                size=self._size,
                max_grey=self._max_grey,
                exposures=self._exposures.state(),
                sampler=self._sampler,
                pixels=self.pixels,
                epochs=[epoch_content(epoch) for epoch in self._epochs],
                skipped=self._skipped,
                reasons=self._reasons,
                first_reasons=self._first_reasons,
                first_frames=self._first_frames,
                source=self.source,
                versions=versions(),
            )
            return save_run(path, run, method, summary)

    @classmethod
    def load_state(cls, path: str | Path) -> OnlineCalibrator:
        """Return a calibrator that goes on where another was when :meth:`save_state` wrote the file.

        Give its :attr:`frames_to_replay` to :meth:`replay` before the next frame is pushed, as :func:`remaining`
        does, and results are the same, bit for bit, as without the interruption. Where these
        frames are gone, it goes on without: the first new frames then have no earlier ones to be compared with.

        Raises
        ------
        FormatError
            If there is no such file, it is torn or damaged, or another version wrote it.
        """
        run, method = load_run(path, EngineState, MaximumLikelihoodState)
        settings = _settings_of(run.settings, str(path))
        try:
            check_run(run, method, settings)
            lag: LagChoice = "trusted" if run.correct_lag == "trusted" else lag_choice(run.correct_lag)
            calibrator = cls(settings, correct_lag=lag)
            calibrator._restore(run, method)
        except (FormatError, SettingError, LookupError, TypeError, ValueError, AttributeError) as error:
            raise FormatError(f"{path}: not readable as a state ({error})") from None
        return calibrator

    def _restore(self, run: EngineState, method: MaximumLikelihoodState | None) -> None:
        """Go on from a state; ValueError if its parts do not fit each other."""
        self._size, self._max_grey = run.size, run.max_grey
        self._sampler, self.pixels = run.sampler, run.pixels
        self._skipped, self._reasons = run.skipped, run.reasons
        self._first_reasons, self._first_frames = run.first_reasons, run.first_frames
        self._epochs = [epoch_of(content) for content in run.epochs]
        self._exposures.restore(run.exposures, self.epochs[-1].first_frame)
        if run.max_grey:
            self._method = self.settings.build(run.size, run.max_grey)
            self._method.restore(method)
        self.source, self.saved_by = run.source, run.versions
        self._update_prefetcher()

    @property
    def frames_to_replay(self) -> frozenset[int]:
        """Numbers of the frames that :meth:`replay` needs before a loaded calibrator goes on."""
        if self._method is None:
            return frozenset()
        return self._method.frames_to_replay | self._exposures.history.frames_to_replay

    def replay(self, frame: Frame) -> None:
        """Process a frame again that new ones were being compared with.

        FrameError if its image cannot be read any more, or has another size.
        """
        if self._method is not None:
            shown = replace(frame, load=partial(image_of_size, frame, self._size))
            prepared = self._preprocess(shown, self.pixels.range_before(frame.index))
            self._method.replay(prepared)
            self._exposures.history.replay(prepared.thumbnail)


def _settings_of(content: dict[str, Any], name: str) -> DefaultSettings:
    try:
        values = {key: str(value) for key, value in content.items() if key != "preset"}
        settings = with_overrides(preset(str(content.get("preset"))), values)
    except SettingError as error:
        raise FormatError(f"{name}: was made by another version of this program ({error})") from None
    if not isinstance(settings, DefaultSettings):
        raise FormatError(f"{name}: was made with preset {settings.name}, which saves no state")
    return settings


def remaining(calibrator: OnlineCalibrator, recording: Iterable[Frame]) -> Iterator[Frame]:
    """Give the frames of a recording that were not pushed to a calibrator yet, after replaying those that it needs.

    The calibrator is new, or was loaded from a state of a run over the same recording. FrameError if a frame that had
    been read before cannot be read any more.
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
    """Push all frames :func:`remaining`, decoded ahead by another thread: the only loop over frames.

    ``after_frame`` is called after each frame with it and whether it could be used; it ends the run early by raising.
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
        A recording, the path of one, or any iterable of frames or of (image, exposure in ms).
    settings
        Settings of the method, or the name of a preset.
    correct_lag
        What to do where exposures are written beside other frames than their own: correct it where it is certain
        (``"auto"``), ``"never"``, or by that many frames, positive if exposures come late.
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
    SettingError
        If ``correct_lag`` is none of these, or leaves nothing of the frames.
    OspcError
        If none of its frames can be used.
    """
    source = open_recording(recording) if isinstance(recording, str | Path) else recording
    if isinstance(source, Recording):
        calibrator = OnlineCalibrator.of(source, settings, correct_lag=correct_lag)
        calibrator.source = identity(source)
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
