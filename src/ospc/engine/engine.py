"""The calibration engine: every step a frame goes through. All commands and calibrators use it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from hashlib import sha256
from threading import RLock
from typing import Any, NoReturn

from ospc.arrays import ImageSize, size_of
from ospc.correspondence.pixel_statistics import PixelStatistics
from ospc.correspondence.thumbnail import Thumbnail
from ospc.engine.frame_checks import SkippedFrames, check_is_frame, checked_frame, why_greys_are_useless
from ospc.engine.prefetching import Prefetcher
from ospc.engine.state import Epoch, keeping_latest_calibrations, response_before_change
from ospc.engine.verdicts import checked_by_fit, compared_with_epoch_before, judged
from ospc.errors import ExposureError, FrameError, OspcError, RecordingError, SettingError
from ospc.exposures.brightness import ComparedFrames
from ospc.exposures.brightness_history import BrightnessHistory
from ospc.exposures.findings import ExposureFindings
from ospc.exposures.lag_choice import LagChoice, lag_in_words
from ospc.exposures.monitor import ExposureMonitor
from ospc.exposures.table import ExposureTable
from ospc.exposures.used import with_earlier_exposures
from ospc.methods.change_detection import Change
from ospc.methods.fit_inputs import FitInputs
from ospc.methods.method import Method, Progress
from ospc.methods.preview import Preview
from ospc.photometry.calibration import Calibration
from ospc.photometry.grey_range import GreyRange
from ospc.pooling.prior_calibration import PriorCalibration
from ospc.pooling.summary import Summary, summary_of
from ospc.recording.frame import UNNAMED, Frame, check_exposure
from ospc.settings import Settings, as_dict, preset
from ospc.system.second_thread import SecondThread
from ospc.system.versions import versions

HASHED_FRAMES = 4
"""Number of frames in the hash that identifies a stream."""


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
    """Processes the frames of one camera. The calibration is available at any time.

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
        An earlier calibration of the camera. It is used as a prior as long as it agrees with the frames.

    Attributes
    ----------
    source
        Identification of the recording, saved in states; empty for a live camera.
    saved_by
        Versions of the software that saved the loaded state; empty for a new calibrator.
    prior
        As in the parameters, or None. It is not saved in states.
    pixels
        Grey value statistics of the frames processed in this epoch. Each frame changes them; do not read them while
        another thread pushes.
    prefetcher
        Predicts which frames will be needed, and keeps those that another thread preprocessed ahead of time.
    """

    def __init__(
        self,
        settings: Settings | str = "default",
        *,
        correct_lag: LagChoice = "auto",
        prior: PriorCalibration | None = None,
    ) -> None:
        self.settings = preset(settings) if isinstance(settings, str) else settings
        if not hasattr(self.settings, "sampler"):
            raise SettingError(
                f"settings are of type {type(settings).__name__}; give the name of a preset, or settings such as "
                "DefaultSettings(max_points=5000); images and exposures are passed as pairs: zip(images, exposures)"
            )
        self.source: dict[str, Any] = {}
        self.saved_by: dict[str, Any] = {}
        self.prior = prior
        self.pixels = PixelStatistics()
        self._lock = RLock()
        self._exposures = ExposureMonitor(correct_lag)
        self._sampler = self.settings.sampler()
        self._preprocess = self.settings.preprocessor()
        self.prefetcher = Prefetcher(self._preprocess, self._sampler, lambda: self.pixels.grey_range)
        self._second = SecondThread()
        self._size: ImageSize = (0, 0)
        self._max_grey = 0
        self._method: Method | None = None
        self._epochs: list[Epoch] = []
        self._skipped = SkippedFrames()
        self._first_frames = ("", 0)
        self._partly_processed = ""  # name of a frame whose processing failed halfway

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
            check_is_frame(frame, self.frames)
            number = self._exposures.table.append(frame.exposure_ms)
            if frame.name == UNNAMED:
                frame = replace(frame, name=f"frame {number}")
            try:
                size = None if self._method is None else self._size
                self._process(checked_frame(frame, number, size, self._max_grey))
            except (FrameError, ExposureError) as error:
                self._skip(str(error))
                return False
            except RecordingError:
                self._exposures.table = self._exposures.table.before(number)
                raise
            except BaseException:
                self._partly_processed = frame.name
                raise
            finally:
                self.prefetcher.drop_until(number)
                self._update_prefetcher()
            return True

    def push_without_image(self, exposure_ms: float, name: str, unusable: str = "") -> bool:
        """Count a frame whose image is not needed, and return whether it could have been used.

        ``unusable`` is the reason why its image cannot be used, if it has been checked.
        """
        with self._lock:
            self._exposures.table.append(exposure_ms)
            try:
                check_exposure(exposure_ms, name)
            except ExposureError as error:
                unusable = str(error)
            self._skip(unusable)
            self._update_prefetcher()
        return not unusable

    def __getstate__(self) -> NoReturn:
        """Refuse to be pickled or copied."""
        raise OspcError(
            "a calibrator cannot be pickled or copied; save it with save_state, and load it with "
            "OnlineCalibrator.load_state"
        )

    # The steps of push.

    def _process(self, frame: Frame) -> None:
        """Run all steps of the method on a frame, only the comparison of brightness, or none."""
        method = self._started(frame)
        self._hash(frame)  # first: if the image cannot be read, the state must not change
        change: Change | None = None
        compared: ComparedFrames | None = None
        repeats = False
        if self._sampler.processes_next:
            change, compared, repeats = self._observe(method, frame)
        elif self._sampler.compares_next or self._exposures.needs_comparison(frame.index):
            compared = self._exposures.history.observe(*self.prefetcher.thumbnail(frame))
        if compared is not None:
            change = change or method.compare(compared.points, self._exposures.table)
            change = self._detect_lag_change(method, change) or change
        if change is not None:
            method = self._begin_epoch_if_confirmed(method, change)
        if repeats:
            self._sampler.skip()
        else:
            self._sampler.advance(method.longest_pause)
        self._exposures.assess_if_due()

    def _started(self, frame: Frame) -> Method:
        """Return the method, creating it for frames like the first."""
        if self._method is None:
            size = size_of(frame.image)
            self._method = self.settings.build(size, frame.max_grey)
            self._size, self._max_grey = size, frame.max_grey
        return self._method

    def _hash(self, frame: Frame) -> None:
        """Add the first frames to the hash that identifies this stream."""
        digest, count = self._first_frames
        if count < HASHED_FRAMES:
            content = f"{digest} {frame.stamp_s!r} {frame.exposure_ms!r} ".encode() + frame.image.tobytes()
            self._first_frames = (sha256(content).hexdigest(), count + 1)

    def _observe(self, method: Method, frame: Frame) -> tuple[Change | None, ComparedFrames | None, bool]:
        """Preprocess a frame and accumulate its samples.

        Return a change of the camera, the compared frames, and whether the frame only repeats the previous image.
        """
        prepared, precomputed = self.prefetcher.preprocessed(frame)
        first = self._exposures.history.first_with_image_of(prepared.thumbnail)
        if first != frame.index:  # it adds no information
            self._count_repeated(frame, prepared.thumbnail, first)
            return None, None, True
        # Meanwhile, the second thread counts grey values and compares the brightness with the previous frame.
        counting = self._second.submit(self.pixels.observe, frame, prepared.thumbnail)
        comparing = self._second.submit(self._exposures.history.observe, prepared.thumbnail, precomputed)
        try:
            # Select a keyframe, register the frame with it, sample both, accumulate the samples.
            change = method.push(frame, prepared, self._exposures.table)
        finally:
            counting.result()
            compared = comparing.result()
        return change, compared, False

    def _count_repeated(self, frame: Frame, thumbnail: Thumbnail, first: int) -> None:
        """Count a frame with the image of the ``first`` one; FrameError if it has another exposure."""
        self._sampler.expects_repeats = True
        self._exposures.history.observe(thumbnail)
        written = self._exposures.table.written
        if written[frame.index] != written[first]:
            raise FrameError(f"{frame.name}: repeats the previous image with another exposure, so an image was lost")

    def _detect_lag_change(self, method: Method, other: Change | None) -> Change | None:
        """Return a change of the exposure lag, which may explain another change of the camera."""
        found = self._exposures.detect_lag_change(camera_changed=other is not None)
        if found is None or not method.agrees_with(found, self._exposures.table):
            return None
        self._exposures.follow_lag_change(found)
        late = lag_in_words(found.later_frames)
        description = f"exposures are recorded {late} compared with earlier frames"
        return Change(found.frame, self.frames - 1, "exposures", description)

    def _begin_epoch_if_confirmed(self, method: Method, suspected: Change) -> Method:
        """Return the method for the frames after a change of the camera, or the same one if its fit shows none."""
        exposures, found, grey_range = self._used_before(method, suspected.frame)
        inputs = method.inputs(exposures, grey_range)
        change = suspected if inputs is None else method.prove_again(suspected, inputs, self._exposures.table)
        if change is None:
            return method
        first, begin = self.epochs[-1].first_frame, change.frame
        if begin != suspected.frame:
            exposures, found, grey_range = self._used_before(method, begin)
        ended = self._judged(method.calibration(exposures, grey_range), found, {"frames": begin - first})
        epoch = Epoch(first, begin - 1, ended, change, found.corrected_frames, found.evidence.wrong)
        self._epochs = keeping_latest_calibrations([*self._epochs, epoch])
        self._exposures.begin_epoch(begin)
        self.pixels = self.pixels.of_next_epoch()
        self._method = method.since(begin)
        self._sampler.begin_epoch()
        return self._method

    def _used_before(self, method: Method, frame: int) -> tuple[ExposureTable, ExposureFindings, GreyRange]:
        """Return the exposures that a result from the frames before another uses, their findings, and grey range."""
        recorded, found = self._exposures.table.before(frame), self._exposures.findings_before(frame)
        grey_range = self.pixels.grey_range_before(frame)
        used = checked_by_fit(method, recorded, found, grey_range, interlaced=self.pixels.interlaced)
        return *used, grey_range

    def _skip(self, reason: str) -> None:
        """Skip a frame; ``reason`` is empty if it could have been used."""
        if reason:
            self._skipped = self._skipped.with_another(reason)
        self._sampler.skip()

    def _update_prefetcher(self) -> None:
        """Pass the current sampler to the prefetcher, which copies it so that it never waits for the lock."""
        every = self._method is not None and self._method.longest_pause == 0
        self.prefetcher.update(self._sampler, self._size, every=every)

    # The result of the frames so far.

    def calibration(self) -> Calibration:
        """Return the calibration from the frames so far; more may be pushed later. OspcError if none was usable."""
        with self._lock:
            if self._method is None:
                why = f": {self._skipped.latest[-1]}" if self._skipped.latest else ""
                raise OspcError(f"no frame could be used{why}")
            exposures, found = self._used_exposures(self._method)
            known = self._method.calibration(exposures, self.pixels.grey_range)
            earlier = self.prior or response_before_change(self._epochs, self._exposures.table.written)
            if earlier is not None:
                known = earlier.continued(known, self.summary())
            result = self._judged(known, found, {"frames": self.frames, "skipped": self._skipped.count})
            ended = ((e.last_frame + 1, e.corrected_lag_frames, e.wrong_exposures) for e in self._epochs)
            return replace(result, source=with_earlier_exposures(self.source | result.source, ended))

    def _used_exposures(self, method: Method) -> tuple[ExposureTable, ExposureFindings]:
        """Return the exposures that the result uses, and the findings about them."""
        recorded, found, pixels = self._exposures.table, self._exposures.findings(), self.pixels
        return checked_by_fit(method, recorded, found, pixels.grey_range, interlaced=pixels.interlaced)

    def _judged(self, known: Calibration, found: ExposureFindings, counts: dict[str, int]) -> Calibration:
        """Return a calibration with the counts of its frames and the verdicts that exposures and images allow."""
        cause = self._skipped.why_most_of(self.frames) or why_greys_are_useless(self.pixels.report())
        changes = [epoch.change.text for epoch in self._epochs if epoch.change]
        found = compared_with_epoch_before(found, known, self._epochs[-1].calibration if self._epochs else None)
        result = judged(known, found, cause, changes)
        return replace(result, counts=counts | known.counts, settings=as_dict(self.settings), versions=versions())

    def exposure_findings(self) -> ExposureFindings:
        """Return the findings about the exposures so far; OspcError if no frame was usable."""
        with self._lock:
            if self._method is None:
                raise OspcError("no frame could be used, so the exposures could not be checked")
            return self._used_exposures(self._method)[1]

    def inputs(self) -> FitInputs | None:
        """Return the inputs of the fit of response and vignette; None if nothing can be merged."""
        with self._lock:
            if self._method is None:
                return None
            return self._method.inputs(self._used_exposures(self._method)[0], self.pixels.grey_range)

    def summary(self) -> Summary | None:
        """Return a summary that can be merged with others; None if there is nothing to merge."""
        inputs = self.inputs()
        return None if inputs is None else summary_of(inputs, self._first_frames[0], self.source, self.frames)

    def preview(self) -> Preview | None:
        """Return quick estimates and the data behind them, for display during a run; None before there are any."""
        with self._lock:
            return None if self._method is None else self._method.preview(self._exposures.table)

    def end_threads(self) -> None:
        """End the threads that help to process a frame; the next frame starts them again."""
        with self._lock:
            self._second.end()
            if self._method is not None:
                self._method.end_threads()

    # These do not wait for other threads.

    @property
    def status(self) -> Status:
        """Status of the run; cheap enough to read after every frame."""
        progress = self._method.progress if self._method else Progress()
        return Status(self.frames, self._skipped.latest, progress)

    @property
    def frames(self) -> int:
        """Number of frames pushed so far, including skipped ones."""
        return len(self._exposures.table)

    @property
    def processed(self) -> int:
        """Number of frames processed so far."""
        return self._sampler.processed

    @property
    def epochs(self) -> tuple[Epoch, ...]:
        """The epochs of the camera so far; a new one begins with each change, and the last is the current one.

        The last eight that have ended keep their calibrations.
        """
        ended = tuple(self._epochs)  # read once: the thread that pushes may replace them at any time
        first = ended[-1].last_frame + 1 if ended else 0
        return (*ended, Epoch(first, self.frames - 1, None, None))

    @property
    def first_reasons(self) -> tuple[str, ...]:
        """Why the first unusable frames were skipped, three at most."""
        return self._skipped.first

    @property
    def correct_lag(self) -> LagChoice:
        """How a lag of the exposures is handled."""
        return self._exposures.choice

    @property
    def brightness(self) -> BrightnessHistory:
        """Changes of brightness between consecutive frames of this epoch; do not read them during a push."""
        return self._exposures.history

    def may_need_image(self, number: int) -> bool:
        """Whether the image of the frame with this number may be needed."""
        return self._exposures.lag_is_uncertain or self.prefetcher.needs(number)
