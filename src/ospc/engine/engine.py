"""The calibration engine: every step a frame goes through. All commands and calibrators use it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from threading import RLock
from typing import Any

from ospc.arrays import size_of
from ospc.correspondence.pixel_statistics import PixelStatistics
from ospc.correspondence.preprocessing import PreprocessedFrame
from ospc.engine.frame_checks import check_is_frame, checked_frame, image_of_size
from ospc.engine.state import Epoch, Run, response_before_change
from ospc.errors import ExposureError, FrameError, RecordingError, SettingError
from ospc.exposures.brightness import ComparedFrames
from ospc.exposures.brightness_history import BrightnessHistory
from ospc.exposures.lag_choice import LagChoice, lag_in_words
from ospc.exposures.table import ExposureTable
from ospc.methods.change_detection import Change
from ospc.methods.fit_inputs import FitInputs
from ospc.methods.method import Method, Progress
from ospc.photometry.calibration import Calibration
from ospc.photometry.grey_range import GreyRange
from ospc.pooling.prior_calibration import PriorCalibration
from ospc.pooling.summary import Summary, summary_of
from ospc.recording.frame import UNNAMED, Frame, check_exposure
from ospc.settings import Settings
from ospc.system.second_thread import SecondThread


@dataclass(frozen=True)
class Status:
    """Status of a run.

    ``frames`` counts the frames pushed so far, including skipped ones. ``skipped`` has the reasons of the last twenty
    skipped frames at most, the latest last. ``progress`` has figures from the method.
    """

    frames: int
    skipped: tuple[str, ...]
    progress: Progress


class Engine:
    """Processes the frames of one camera. All methods are thread-safe.

    Attributes
    ----------
    settings
        Settings of the method.
    prior
        An earlier calibration of the camera, or None. It is not saved in states.
    """

    def __init__(self, settings: Settings, run: Run) -> None:
        self.settings = settings
        self.prior: PriorCalibration | None = None
        self._run = run
        self._method: Method | None = None  # until the first usable frame
        self._partly_processed = ""  # the name of a frame whose processing failed halfway
        self._lock = RLock()  # held while a frame is processed
        self._preprocess = settings.preprocessor()
        self._expect()
        self._second = SecondThread()

    def push(self, frame: Frame) -> bool:
        """Process the next frame and return whether it could be used. Most frames are not even decoded.

        A frame that cannot be read, or whose size, exposure, largest grey value or mask is wrong, is skipped and
        counted.

        Raises
        ------
        FrameError
            If ``frame`` is not a :class:`Frame`.
        RecordingError
            If no more frames can be read. The state is unchanged, and the frame may be pushed again.
        """
        with self._lock:
            check_is_frame(frame, self._run.frames)
            number = self._run.exposures.table.append(frame.exposure_ms)
            if frame.name == UNNAMED:
                frame = replace(frame, name=f"frame {number}")
            try:
                size = None if self._method is None else self._run.size
                self._process(checked_frame(frame, number, size, self._run.max_grey))
            except (FrameError, ExposureError) as error:
                self._run.skip(str(error))
                return False
            except RecordingError:
                self._run.exposures.table = self._run.exposures.table.before(number)
                raise
            except BaseException:
                self._partly_processed = frame.name
                raise
            finally:
                self._expect()
            return True

    def push_without_image(self, exposure_ms: float, name: str, unusable: str = "") -> bool:
        """Count a frame whose image is not needed, and return whether it could have been used.

        ``unusable`` is the reason why its image cannot be used, if it has been checked.
        """
        with self._lock:
            self._run.exposures.table.append(exposure_ms)
            try:
                check_exposure(exposure_ms, name)
            except ExposureError as error:
                unusable = str(error)
            self._run.skip(unusable)
            self._expect()
            return not unusable

    @property
    def frames_to_replay(self) -> frozenset[int]:
        """Numbers of the frames that :meth:`replay` needs before a loaded calibrator continues."""
        with self._lock:
            if self._method is None:
                return frozenset()
            return self._method.frames_to_replay | self._run.exposures.history.frames_to_replay

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
            shown = replace(frame, load=partial(image_of_size, frame, self._run.size))
            prepared = self._preprocess(shown, self._run.pixels.grey_range_before(frame.index))
            self._method.replay(prepared)
            self._run.exposures.history.replay(prepared.thumbnail)

    def end_threads(self) -> None:
        """End the threads that help to process a frame; the next frame starts them again."""
        with self._lock:
            self._second.end()
            if self._method is not None:
                self._method.end_threads()

    def _restore(self, run: Run, method: object | None) -> None:
        """Continue from a loaded state; FormatError or ValueError if run and method are inconsistent."""
        with self._lock:
            if method is not None:
                self._method = self.settings.build(run.size, run.max_grey)
                self._method.restore(method, run.frames)
            self._run = run
            self._expect()

    # The steps of push.

    def _process(self, frame: Frame) -> None:
        """Run all steps of the method on a frame, only the comparison of brightness, or none."""
        method = self._started(frame)
        self._run.identify_by(frame)  # first: if the image cannot be read, the state must not change
        change: Change | None = None
        compared: ComparedFrames | None = None
        if self._run.sampler.processes_next:
            prepared = self._preprocess(frame, self._run.pixels.grey_range)
            first = self._run.exposures.history.first_with_image_of(prepared.thumbnail)
            if first != frame.index:  # it adds no information
                self._run.count_repeated(frame, prepared.thumbnail, first)
                self._assess_exposures_if_due(method)
                return
            change, compared = self._observe(method, frame, prepared)
        elif self._run.sampler.compares_next or self._run.exposures.needs_comparison(frame.index):
            thumbnail = self._preprocess.thumbnail(frame, self._run.pixels.grey_range)
            compared = self._run.exposures.history.observe(thumbnail)
        if compared is not None:
            change = change or method.compare(compared.points, self._run.exposures.table)
            change = self._detect_lag_change(method, change) or change
        if change is not None:
            method = self._begin_epoch_if_confirmed(method, change)
        self._run.sampler.advance(method.longest_pause)
        self._assess_exposures_if_due(method)

    def _started(self, frame: Frame) -> Method:
        """Return the method, creating it for frames like the first."""
        if self._method is None:
            size = size_of(frame.image)
            self._method = self.settings.build(size, frame.max_grey)
            self._run.size, self._run.max_grey = size, frame.max_grey
        return self._method

    def _observe(
        self, method: Method, frame: Frame, prepared: PreprocessedFrame
    ) -> tuple[Change | None, ComparedFrames | None]:
        """Accumulate the samples of a preprocessed frame; return a change of the camera, and the compared frames."""
        # Meanwhile, the second thread counts grey values and compares the brightness with the previous frame.
        counting = self._second.submit(self._run.pixels.observe, frame, prepared.thumbnail)
        comparing = self._second.submit(self._run.exposures.history.observe, prepared.thumbnail)
        try:
            # Select a keyframe, register the frame with it, sample both, accumulate the samples.
            change = method.push(frame, prepared, self._run.exposures.table)
        finally:
            counting.result()
            compared = comparing.result()
        return change, compared

    def _assess_exposures_if_due(self, method: Method) -> None:
        """Assess the exposures after many more brightness changes; a fit must confirm a new lag."""
        exposures = self._run.exposures
        if not exposures.assessment_is_due:
            return
        found = exposures.findings()
        if exposures.is_new_lag(found):
            found = self._run.used_before(self.frames, method)[1]
        exposures.adopt(found)

    def _detect_lag_change(self, method: Method, other: Change | None) -> Change | None:
        """Return a change of the exposure lag, which may explain another change of the camera."""
        found = self._run.exposures.detect_lag_change(camera_changed=other is not None)
        if found is None or not method.agrees_with(found, self._run.exposures.table):
            return None
        self._run.exposures.follow_lag_change(found)
        late = lag_in_words(found.later_frames)
        description = f"exposures are recorded {late} compared with earlier frames"
        return Change(found.frame, self._run.frames - 1, "exposures", description)

    def _begin_epoch_if_confirmed(self, method: Method, suspected: Change) -> Method:
        """Return the method for the frames after a change of the camera, or the same one if its fit shows none."""
        run = self._run
        exposures, found, grey_range = run.used_before(suspected.frame, method)
        inputs = method.inputs(exposures, grey_range)
        change = suspected if inputs is None else method.prove_again(suspected, inputs, run.exposures.table)
        if change is None:
            return method
        first, begin = run.all_epochs[-1].first_frame, change.frame
        exposures, found, grey_range = run.used_before(begin, method)
        known = self._with_earlier(method, exposures, grey_range)
        known = run.judged(known, found, {"frames": begin - first})
        run.begin_epoch(Epoch(first, begin - 1, known, change, found.corrected_frames, found.evidence.wrong))
        self._method = method.since(begin)
        return self._method

    def _with_earlier(self, method: Method, exposures: ExposureTable, grey_range: GreyRange) -> Calibration:
        """Return the calibration of the current epoch together with what was known of the camera before it."""
        run = self._run
        own = method.calibration(exposures, grey_range)
        earlier = response_before_change(run.epochs, run.exposures.table.log_recorded) if run.epochs else self.prior
        if earlier is None:
            return own
        return earlier.continued(own, self._summary_of(method.inputs(exposures, grey_range)))

    def _summary_of(self, inputs: FitInputs | None) -> Summary | None:
        run = self._run
        return None if inputs is None else summary_of(inputs, run.first_frames[0], run.source, run.frames)

    def _expect(self) -> None:
        """Note which images will be needed: all of them, or those that a copy of the sampler selects."""
        every = self._method is not None and self._method.longest_pause == 0
        self._expected = every, replace(self._run.sampler)

    # These do not wait for other threads.

    @property
    def source(self) -> dict[str, Any]:
        """Identification of the recording, saved in states; empty for a live camera.

        It may be set to a dictionary of JSON-compatible values; SettingError for anything else.
        """
        return self._run.source

    @source.setter
    def source(self, source: dict[str, Any]) -> None:
        if not isinstance(source, dict):
            raise SettingError(f"source is of type {type(source).__name__}; give a dictionary")
        self._run.source = source

    @property
    def saved_by(self) -> dict[str, Any]:
        """Versions of the software that saved the loaded state; empty for a new calibrator."""
        return self._run.versions

    @property
    def status(self) -> Status:
        """Status of the run; cheap enough to read after every frame."""
        progress = self._method.progress if self._method else Progress()
        return Status(self.frames, self._run.skipped.latest, progress)

    @property
    def frames(self) -> int:
        """Number of frames pushed so far, including skipped ones."""
        return self._run.frames

    @property
    def processed(self) -> int:
        """Number of frames processed so far."""
        return self._run.sampler.processed

    @property
    def epochs(self) -> tuple[Epoch, ...]:
        """The epochs of the camera so far; a new one begins with each change, and the last is the current one.

        The last eight that have ended keep their calibrations.
        """
        return self._run.all_epochs

    @property
    def first_reasons(self) -> tuple[str, ...]:
        """Why the first unusable frames were skipped, three at most."""
        return self._run.skipped.first

    @property
    def correct_lag(self) -> LagChoice:
        """How a lag of the exposures is handled."""
        return self._run.exposures.choice

    @property
    def brightness(self) -> BrightnessHistory:
        """Changes of brightness between consecutive frames of this epoch; do not read them during a push."""
        return self._run.exposures.history

    @property
    def pixels(self) -> PixelStatistics:
        """Grey value statistics of the frames processed in this epoch; do not read them during a push."""
        return self._run.pixels

    def will_need_image(self, number: int) -> bool:
        """Whether the image of the frame with this number will probably be needed."""
        every, sampler = self._expected
        return every or sampler.at(number).compares_next

    def may_need_image(self, number: int) -> bool:
        """Whether the image of the frame with this number may be needed."""
        return self._run.exposures.lag_is_uncertain or self.will_need_image(number)
