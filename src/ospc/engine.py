"""The run: everything a frame goes through, in one place. Whatever calibrates drives this."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial, wraps
from hashlib import sha256
from threading import RLock
from typing import Any, Concatenate, ParamSpec, TypeVar, cast

import numpy as np
from threadpoolctl import threadpool_limits

from ospc.arrays import FloatArray, Image, ImageSize
from ospc.correspondence.pixel_statistics import PixelStatistics
from ospc.correspondence.preprocessing import PreprocessedFrame
from ospc.correspondence.second_thread import SecondThread
from ospc.correspondence.thumbnail import Thumbnail
from ospc.engine_state import EngineState, Epoch, epoch_content, epoch_of
from ospc.errors import ExposureError, FrameError, OspcError, RecordingError
from ospc.exposures.brightness import BrightnessComparer
from ospc.exposures.evidence import ComparedAhead, ExposureEvidence
from ospc.exposures.findings import ExposureFindings, LagChoice, assess_exposures
from ospc.exposures.table import ExposureTable
from ospc.methods.change_detection import Change
from ospc.methods.inputs import FitInputs
from ospc.methods.method import Method, Progress
from ospc.methods.preview import Preview
from ospc.photometry.calibration import Calibration
from ospc.photometry.grey_range import GreyRange
from ospc.recording.frame import Frame
from ospc.settings import Settings, as_dict, preset
from ospc.versions import versions

FIRST_ASSESSMENT = 39
"""Changes of brightness before the exposures are assessed the first time: fewer seldom settle a lag."""

MOST_OPEN_CHANGES = 400
"""Changes of brightness beyond which a lag that is still not known is looked for in the usual runs of frames only."""

RECENT_FRAMES = 8
"""Frames around a frame over which the exposure must change for it to tell the lag: the largest lag and some."""

MIN_RECENT_CHANGE_LOG = 0.02
"""Change of ln exposure over these frames that shows in the images."""

ASSESSMENT_GROWTH = 1.5
"""Exposures are assessed again whenever there are so many times more changes of brightness."""

REMEMBERED_REASONS, FIRST_REASONS = 20, 3
"""How many of the latest, and of the first, reasons for skipping a frame are kept."""

RECOGNIZED_BY = 4
"""Frames in the hash that tells streams apart."""


@dataclass(frozen=True)
class Status:
    """Where a run stands.

    Attributes
    ----------
    frames
        Frames pushed so far, skipped ones included.
    skipped
        Why frames could not be used, the latest last, at most twenty.
    progress
        The method's own figures.
    """

    frames: int
    skipped: tuple[str, ...]
    progress: Progress


Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


def _one_thread_at_a_time(
    method: Callable[Concatenate[Engine, Arguments], Result],
) -> Callable[Concatenate[Engine, Arguments], Result]:
    @wraps(method)
    def locked(self: Engine, *args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        with self._lock:
            return method(self, *args, **kwargs)

    return cast("Callable[Concatenate[Engine, Arguments], Result]", locked)


class Engine:
    """Takes the frames of one camera one by one, in bounded memory, and knows the calibration at any moment.

    Frames are numbered in the order in which they are pushed. All methods may be called by any thread.

    Parameters
    ----------
    settings
        Settings of the method, or the name of a preset.
    correct_lag
        What to do where exposures are written beside other frames than their own: correct it where it is certain
        (``"auto"``), ``"never"``, or by so many frames, positive if exposures come late.
    """

    def __init__(self, settings: Settings | str = "default", *, correct_lag: LagChoice = "auto") -> None:
        self._settings = preset(settings) if isinstance(settings, str) else settings
        self._correct_lag = correct_lag
        self._lock = RLock()
        self._exposures = ExposureTable(correct_lag if isinstance(correct_lag, int) else 0)
        self._sampler = self._settings.sampler()
        self._foresight = (False, replace(self._sampler))
        self._preprocess = self._settings.preprocessor()
        self._prepared_ahead: dict[int, tuple[Image, GreyRange, PreprocessedFrame]] = {}
        self._reduced_ahead: dict[int, tuple[Image, Thumbnail, ComparedAhead | None]] = {}
        self._latest_ahead: Thumbnail | None = None
        self._compare_ahead = BrightnessComparer((0, 0))
        self._pixels = PixelStatistics()
        self._second = SecondThread()
        self._size: ImageSize = (0, 0)
        self._max_grey = 0
        self._evidence: ExposureEvidence | None = None
        self._method: Method | None = None
        self._next_assessment = FIRST_ASSESSMENT
        self._lag_is_known = False
        self._findings: tuple[tuple[int, int], ExposureFindings] | None = None
        self._epochs: list[Epoch] = []
        self._skipped = 0
        self._reasons: list[str] = []
        self._first_reasons: list[str] = []
        self._first_frames = ("", 0)
        self._half_taken = ""  # name of a frame within which something failed

    @_one_thread_at_a_time
    def push(self, frame: Frame) -> bool:
        """Take the next frame and return whether it could be used; most often it is not even decoded.

        A frame that cannot be read, or whose size or exposure is wrong, is skipped and counted; the run goes on.

        Raises
        ------
        RecordingError
            If no frame can be read any more. Nothing has changed then, and the frame may be pushed again.
        """
        number = self._exposures.append(frame.exposure_ms)
        used = True
        try:
            self._check(frame)
            self._take(replace(frame, index=number, load=partial(_of_size, frame, self._size_of(frame))))
        except (FrameError, ExposureError) as error:
            self._skip(str(error))
            self._sampler.skip()
            used = False
        except RecordingError:
            self._exposures = self._exposures.until(number)
            raise
        except BaseException:
            self._half_taken = frame.name
            raise
        finally:
            self._prepared_ahead.pop(number, None)
            self._reduced_ahead.pop(number, None)
        self._foresee()
        return used

    @_one_thread_at_a_time
    def note(self, exposure_ms: float) -> None:
        """Take note of a frame whose image is not to be had: of its exposure only."""
        self._exposures.append(exposure_ms)
        self._sampler.skip()
        self._foresee()

    def _take(self, frame: Frame) -> None:
        evidence, method = self._started(frame)
        self._recognize(frame)  # at first: where it cannot read the image, nothing is learned from the frame yet
        change = None
        if self._sampler.processes_next:
            prepared = self._prepared(frame)
            counting = self._second.submit(self._pixels.observe, frame, prepared.thumbnail)
            comparing = self._second.submit(evidence.observe, prepared.thumbnail)
            try:
                change = method.push(frame, prepared, self._exposures)
            finally:
                counting.result()
                brightness = comparing.result()
        elif self._sampler.compares_next or self._exposures_are_open(frame.index):
            brightness = evidence.observe(*self._thumbnail(frame))
        else:
            brightness = None
        if brightness is not None and change is None:
            change = method.compare(brightness, self._exposures)
        if change is not None:
            evidence, method = self._begin_epoch(evidence, method, change)
        self._sampler.advance(pauses=not method.wants_every_frame)
        self._assess_exposures_at_times(evidence)

    @_one_thread_at_a_time
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
        found = self.exposure_findings()
        exposures = self._exposures.with_lag(found.corrected_frames)
        known = self._method.calibration(exposures, self._pixels.grey_range)
        return self._judged(known, found)

    @_one_thread_at_a_time
    def exposure_findings(self) -> ExposureFindings:
        """Return what the images say about the exposures so far.

        Raises
        ------
        OspcError
            If no frame could be read so far.
        """
        if self._evidence is None:
            raise OspcError("no frame could be used, so nothing is known about the exposures")
        key = (len(self._exposures), len(self._evidence))
        if self._findings is None or self._findings[0] != key:
            self._findings = (key, self._assessed(self._evidence, self._exposures.written))
        return self._findings[1]

    @_one_thread_at_a_time
    def inputs(self) -> FitInputs | None:
        """Return the evidence on response and vignette; None where there is none that could be merged."""
        if self._method is None:
            return None
        exposures = self._exposures.with_lag(self.exposure_findings().corrected_frames)
        return self._method.inputs(exposures, self._pixels.grey_range)

    @property
    def status(self) -> Status:
        """Where the run stands; cheap enough to ask for after every frame."""
        progress = self._method.progress if self._method else Progress()
        return Status(self.frames, tuple(self._reasons), progress)

    @_one_thread_at_a_time
    def preview(self) -> Preview | None:
        """Return quick estimates and what they rest on, to be watched during a run; None before there are any."""
        return None if self._method is None else self._method.preview(self._exposures)

    def foresees(self, number: int) -> bool:
        """Whether the image of the frame with this number will most likely be needed; waits for no other thread."""
        every, sampler = self._foresight
        return every or sampler.foreseen(number).compares_next

    def prepare(self, number: int, frame: Frame) -> None:
        """Prepare a frame that will be pushed with this number; one thread at a time may, and waits for no other."""
        if frame.image.shape != self._size[::-1]:
            return
        every, sampler = self._foresight
        numbered, previous = replace(frame, index=number), self._latest_ahead
        if every or sampler.foreseen(number).processes_next:
            grey_range = self._pixels.grey_range
            prepared = self._preprocess(numbered, grey_range)
            self._prepared_ahead[number] = (frame.image, grey_range, prepared)
            self._latest_ahead = prepared.thumbnail
            return
        thumbnail, compared = self._preprocess.thumbnail(numbered), None
        if previous is not None and previous.frame == number - 1:
            compared = ComparedAhead(previous, thumbnail, self._compare_ahead(previous, thumbnail))
        self._reduced_ahead[number] = (frame.image, thumbnail, compared)
        self._latest_ahead = thumbnail

    def may_need(self, number: int) -> bool:
        """Whether the image of the frame with this number can be needed at all; waits for no other thread."""
        return self._lag_is_open or self.foresees(number)

    @property
    def frames(self) -> int:
        """Frames pushed so far, skipped ones included: the number of the next."""
        return len(self._exposures)

    @property
    def processed(self) -> int:
        """Frames processed so far."""
        return self._sampler.processed

    @property
    def epochs(self) -> tuple[Epoch, ...]:
        """The epochs of the camera so far, one more than it changed; the present one is the last."""
        return (*self._epochs, Epoch(self._first_of_epoch, self.frames - 1, None, None))

    @property
    def _first_of_epoch(self) -> int:
        return self._epochs[-1].last_frame + 1 if self._epochs else 0

    @property
    def settings(self) -> Settings:
        """Settings of the method."""
        return self._settings

    @property
    def correct_lag(self) -> LagChoice:
        """What is done about a lag of the exposures."""
        return self._correct_lag

    @property
    def pixels(self) -> PixelStatistics:
        """Statistics of the grey values of the processed frames."""
        return self._pixels

    @property
    def evidence(self) -> ExposureEvidence | None:
        """Changes of brightness between consecutive processed frames; None before the first frame."""
        return self._evidence

    @property
    def first_frames(self) -> str:
        """Hash over the first usable frames, which tells streams apart."""
        return self._first_frames[0]

    @property
    def first_reasons(self) -> tuple[str, ...]:
        """Why the first frames that could not be used were skipped, at most three."""
        return tuple(self._first_reasons)

    # States.

    def state(self, source: dict[str, Any]) -> EngineState:
        """Return all that is known beside the method."""
        return EngineState(
            settings=as_dict(self._settings),
            correct_lag=str(self._correct_lag),
            size=self._size,
            max_grey=self._max_grey,
            log_exposure=self._exposures.written,
            lag_frames=self._exposures.lag_frames,
            exposures_are_trusted=self._exposures.trusted,
            sampler=self._sampler,
            pixels=self._pixels,
            evidence=None if self._evidence is None else self._evidence.state(),
            next_assessment=self._next_assessment,
            lag_is_known=self._lag_is_known,
            epochs=[epoch_content(epoch) for epoch in self._epochs],
            skipped=self._skipped,
            reasons=self._reasons,
            first_reasons=self._first_reasons,
            first_frames=self._first_frames,
            source=source,
            versions=versions(),
        )

    def restore(self, state: EngineState, method_state: Any) -> None:
        """Go on from a state, with the frames :attr:`wanted` given to :meth:`recall` before the next is pushed.

        Raises
        ------
        ValueError
            If its parts do not fit each other.
        """
        self._size, self._max_grey = state.size, state.max_grey
        self._exposures = ExposureTable.of(state.log_exposure, state.lag_frames, trusted=state.exposures_are_trusted)
        self._sampler, self._pixels, self._next_assessment = state.sampler, state.pixels, state.next_assessment
        self._lag_is_known = state.lag_is_known
        self._skipped, self._reasons = state.skipped, state.reasons
        self._first_reasons, self._first_frames = state.first_reasons, state.first_frames
        self._epochs = [epoch_of(content) for content in state.epochs]
        if state.evidence is not None:
            self._evidence = ExposureEvidence.from_state(state.size, state.evidence)
            self._compare_ahead = BrightnessComparer(state.size)
            self._method = self._settings.build(state.size, state.max_grey)
            self._method.restore(method_state)
        self._foresee()

    @property
    def wanted(self) -> frozenset[int]:
        """Numbers of the frames that an engine just restored should be shown again."""
        if self._method is None or self._evidence is None:
            return frozenset()
        return self._method.wanted | self._evidence.wanted

    def recall(self, frame: Frame) -> None:
        """Process a frame again that new ones were being compared with.

        Raises
        ------
        FrameError
            If its image cannot be read any more, or has another size.
        """
        if self._method is not None and self._evidence is not None:
            shown = replace(frame, load=partial(_of_size, frame, self._size))
            prepared = self._preprocess(shown, self._pixels.grey_range)
            self._method.recall(prepared)
            self._evidence.recall(prepared.thumbnail)

    # The steps of push.

    def _prepared(self, frame: Frame) -> PreprocessedFrame:
        """Return a frame prepared: ahead of time, where black and white have not moved since."""
        grey_range = self._pixels.grey_range
        image, expected, prepared = self._prepared_ahead.get(frame.index, (None, None, None))
        if prepared is not None and image is frame.image and expected == grey_range:
            return prepared
        return self._preprocess(frame, grey_range)

    def _thumbnail(self, frame: Frame) -> tuple[Thumbnail, ComparedAhead | None]:
        """Return the thumbnail of a frame, and its comparison with the frame before where that was made ahead."""
        image, thumbnail, compared = self._reduced_ahead.get(frame.index, (None, None, None))
        if thumbnail is not None and image is frame.image:
            return thumbnail, compared
        return self._preprocess.thumbnail(frame), None

    def _begin_epoch(
        self, evidence: ExposureEvidence, method: Method, change: Change
    ) -> tuple[ExposureEvidence, Method]:
        """End the epoch with the calibration before a change of the camera, and go on with what came after it."""
        later_evidence, later_method = evidence.split(change.frame), method.split(change.frame)
        found = self._assessed(evidence, self._exposures.written[: change.frame])
        exposures = self._exposures.until(change.frame).with_lag(found.corrected_frames)
        known = method.calibration(exposures, self._pixels.grey_range)
        self._epochs.append(Epoch(self._first_of_epoch, change.frame - 1, self._judged(known, found), change))
        self._evidence, self._method, self._findings = later_evidence, later_method, None
        self._next_assessment, self._lag_is_known = FIRST_ASSESSMENT, False
        self._sampler.restart()
        return later_evidence, later_method

    def _check(self, frame: Frame) -> None:
        if frame.colour and frame.image.ndim != 2:
            raise FrameError(f"{frame.name}: is in colour; open the recording with one of its channels")
        if not (np.isfinite(frame.exposure_ms) and frame.exposure_ms > 0):
            raise ExposureError(f"{frame.name}: exposure {frame.exposure_ms} ms is not a positive number")
        # Most frames need not be decoded; that one is missing or cut off is found out nevertheless.
        if frame.verify is not None:
            frame.verify()
        elif self._method is not None:
            _of_size(frame, self._size)

    def _size_of(self, frame: Frame) -> ImageSize:
        return self._size if self._method is not None else (frame.image.shape[1], frame.image.shape[0])

    def _started(self, frame: Frame) -> tuple[ExposureEvidence, Method]:
        """Return what takes processed frames, made by the first frame."""
        if self._method is None or self._evidence is None:
            size = self._size_of(frame)
            self._method = self._settings.build(size, frame.max_grey)
            self._evidence = ExposureEvidence(size)
            self._compare_ahead = BrightnessComparer(size)
            self._size, self._max_grey = size, frame.max_grey
        return self._evidence, self._method

    def _foresee(self) -> None:
        """Leave a copy of what decides on the next frames, for threads that must not wait."""
        every = self._method is not None and self._method.wants_every_frame
        self._foresight = (every, replace(self._sampler))

    def _assess_exposures_at_times(self, evidence: ExposureEvidence) -> None:
        if len(evidence) >= self._next_assessment:
            self._next_assessment = int(ASSESSMENT_GROWTH * len(evidence))
            found = self.exposure_findings()
            self._exposures.lag_frames = found.corrected_frames
            self._lag_is_known = found.lag.correction(found.course.cycle_frames) is not None
            self._exposures.trusted = self._lag_is_known and not found.warnings

    def _assessed(self, evidence: ExposureEvidence, log_exposure: FloatArray) -> ExposureFindings:
        # Its matrices are small: further threads of the linear algebra would only wait for each other.
        with threadpool_limits(1, user_api="blas"):
            return assess_exposures(evidence, log_exposure, self._correct_lag, since=self._first_of_epoch)

    @property
    def _lag_is_open(self) -> bool:
        """Whether more changes of brightness may still settle which frames the exposures belong to."""
        if self._correct_lag == "trusted":
            return False
        return not self._lag_is_known and (self._evidence is None or len(self._evidence) < MOST_OPEN_CHANGES)

    def _exposures_are_open(self, number: int) -> bool:
        """Return whether a frame can help to settle the lag: the exposures written around it change."""
        recent = self._exposures.written[max(0, number - RECENT_FRAMES) : number + 1]
        return self._lag_is_open and float(np.nanmax(recent) - np.nanmin(recent)) > MIN_RECENT_CHANGE_LOG

    def _recognize(self, frame: Frame) -> None:
        """Take the first frames into the hash that tells this stream of frames from others."""
        digest, count = self._first_frames
        if count < RECOGNIZED_BY:
            seen = f"{digest} {frame.stamp_s!r} {frame.exposure_ms!r} ".encode() + frame.image.tobytes()
            self._first_frames = (sha256(seen).hexdigest(), count + 1)

    def _skip(self, reason: str) -> None:
        self._skipped += 1
        self._reasons = [*self._reasons, reason][-REMEMBERED_REASONS:]
        self._first_reasons = [*self._first_reasons, reason][:FIRST_REASONS]

    # What the frames so far amount to.

    def _judged(self, known: Calibration, found: ExposureFindings) -> Calibration:
        """Return a calibration with the verdicts that its exposures allow."""
        verdicts = {name: found.judged(verdict) for name, verdict in known.verdicts.items()}
        advice = (found.verdict.remedy, *known.advice) if found.warnings else known.advice
        source: dict[str, Any] = {"exposure_lag_frames": found.lag_frames}
        if found.corrected_frames:
            source["exposure_lag_corrected_frames"] = found.corrected_frames
        return replace(
            known,
            verdicts=verdicts | {"exposures": found.verdict},
            converged=known.converged and not found.warnings,
            counts={"frames": self.frames, "skipped": self._skipped, **known.counts},
            settings=as_dict(self._settings),
            versions=versions(),
            advice=tuple(dict.fromkeys(filter(None, advice))),
            source=known.source | source,
            notes=(*found.notes, *known.notes),
            warnings=(
                *found.warnings,
                *known.warnings,
                *(f"{epoch.change.text}" for epoch in self._epochs if epoch.change),
            ),
        )


def _of_size(frame: Frame, size: ImageSize) -> Image:
    """Return a frame's image, or say that it has another size than the first."""
    height, width = frame.image.shape
    if (width, height) != size:
        raise FrameError(
            f"{frame.name}: {width}×{height} pixels, but the first frame has {size[0]}×{size[1]}; "
            "calibrate each image size on its own"
        )
    return frame.image
