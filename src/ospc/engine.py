"""The run: everything a frame goes through, in one place. Whatever calibrates drives this."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial, wraps
from hashlib import sha256
from threading import RLock
from typing import Any, Concatenate, ParamSpec, TypeVar, cast

import numpy as np

from ospc.arrays import BoolArray, Image, ImageSize
from ospc.correspondence.pixel_statistics import PixelStatistics
from ospc.correspondence.second_thread import SecondThread
from ospc.engine_state import EngineState, Epoch, epoch_content, epoch_of
from ospc.errors import ExposureError, FrameError, OspcError, RecordingError
from ospc.exposures.assessment import ExposureAssessment
from ospc.exposures.evidence import ExposureEvidence
from ospc.exposures.findings import ExposureFindings, LagChoice, lag_in_words
from ospc.foresight import Foresight
from ospc.methods.change_detection import Change
from ospc.methods.inputs import FitInputs
from ospc.methods.method import Method, Progress
from ospc.methods.preview import Preview
from ospc.photometry.calibration import Calibration
from ospc.recording.frame import Frame
from ospc.settings import Settings, as_dict, preset
from ospc.versions import versions

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
        self._lock = RLock()
        self._exposures = ExposureAssessment(correct_lag)
        self._sampler = self._settings.sampler()
        self._preprocess = self._settings.preprocessor()
        self._pixels = PixelStatistics()
        self._foresight = Foresight(self._preprocess, self._sampler, lambda: self._pixels.grey_range)
        self._second = SecondThread()
        self._size: ImageSize = (0, 0)
        self._max_grey = 0
        self._method: Method | None = None
        self._epochs: list[Epoch] = []
        self._skipped = 0
        self._reasons: list[str] = []
        self._first_reasons: list[str] = []
        self._first_frames = ("", 0)
        self._half_taken = ""  # name of a frame within which something failed

    @_one_thread_at_a_time
    def push(self, frame: Frame) -> bool:
        """Take the next frame and return whether it could be used; most often it is not even decoded.

        A frame that cannot be read, or whose size, exposure, largest grey value or mask is wrong, is skipped and
        counted; the run goes on.

        Raises
        ------
        RecordingError
            If no frame can be read any more. Nothing has changed then, and the frame may be pushed again.
        """
        number = self._exposures.table.append(frame.exposure_ms)
        used = True
        try:
            self._check(frame)
            self._take(replace(frame, index=number, load=partial(_of_size, frame, self._size_of(frame))))
        except (FrameError, ExposureError) as error:
            self._skip(str(error))
            self._sampler.skip()
            used = False
        except RecordingError:
            self._exposures.take_back(number)
            raise
        except BaseException:
            self._half_taken = frame.name
            raise
        finally:
            self._foresight.forget(number)
        self._foresee()
        return used

    @_one_thread_at_a_time
    def note(self, exposure_ms: float, name: str, unusable: str = "") -> bool:
        """Take note of a frame without its image, and return whether it could have been used for all that is known.

        Parameters
        ----------
        exposure_ms, name
            Those of the frame.
        unusable
            Why its image cannot be used; empty where nobody looked at it.
        """
        self._exposures.table.append(exposure_ms)
        try:
            _check_exposure(exposure_ms, name)
        except ExposureError as error:
            unusable = str(error)
        if unusable:
            self._skip(unusable)
        self._sampler.skip()
        self._foresee()
        return not unusable

    def _take(self, frame: Frame) -> None:
        method, exposures = self._started(frame), self._exposures
        self._recognize(frame)  # at first: where it cannot read the image, nothing is learned from the frame yet
        change = brightness = None
        if self._sampler.processes_next:
            prepared, compared = self._foresight.frame(frame)
            counting = self._second.submit(self._pixels.observe, frame, prepared.thumbnail)
            comparing = self._second.submit(exposures.observe, prepared.thumbnail, compared)
            try:
                change = method.push(frame, prepared, exposures.table)
            finally:
                counting.result()
                brightness = comparing.result()
        elif self._sampler.compares_next or exposures.wants(frame.index):
            brightness = exposures.observe(*self._foresight.thumbnail(frame))
        if brightness is not None:
            change = change or method.compare(brightness, exposures.table)
            change = self._change_of_lag(change) or change
        if change is not None:
            method = self._begin_epoch(method, change)
        self._sampler.advance(method.longest_pause)
        exposures.reassess()

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
        known = self._method.calibration(self._exposures.corrected, self._pixels.grey_range)
        return self._judged(self._continued(known), self._exposures.findings(), self.frames)

    def _continued(self, known: Calibration) -> Calibration:
        """Return a calibration with what was known before the first frame: here that is nothing."""
        return known

    @_one_thread_at_a_time
    def exposure_findings(self) -> ExposureFindings:
        """Return what the images say about the exposures so far.

        Raises
        ------
        OspcError
            If no frame could be read so far.
        """
        return self._exposures.findings()

    @_one_thread_at_a_time
    def inputs(self) -> FitInputs | None:
        """Return the evidence on response and vignette; None where there is none that could be merged."""
        if self._method is None:
            return None
        return self._method.inputs(self._exposures.corrected, self._pixels.grey_range)

    @property
    def status(self) -> Status:
        """Where the run stands; cheap enough to ask for after every frame."""
        progress = self._method.progress if self._method else Progress()
        return Status(self.frames, tuple(self._reasons), progress)

    @_one_thread_at_a_time
    def preview(self) -> Preview | None:
        """Return quick estimates and what they rest on, to be watched during a run; None before there are any."""
        return None if self._method is None else self._method.preview(self._exposures.table)

    def foresees(self, number: int) -> bool:
        """Whether the image of the frame with this number will most likely be needed; waits for no other thread."""
        return self._foresight.needs(number)

    def prepare(self, number: int, frame: Frame) -> None:
        """Prepare a frame that will be pushed with this number; one thread at a time may, and waits for no other."""
        self._foresight.prepare(number, frame)

    def may_need(self, number: int) -> bool:
        """Whether the image of the frame with this number can be needed at all; waits for no other thread."""
        return self._exposures.lag_is_open or self.foresees(number)

    @property
    def frames(self) -> int:
        """Frames pushed so far, skipped ones included: the number of the next."""
        return len(self._exposures.table)

    @property
    def processed(self) -> int:
        """Frames processed so far."""
        return self._sampler.processed

    @property
    def epochs(self) -> tuple[Epoch, ...]:
        """The epochs of the camera so far, one more than it changed; the present one is the last."""
        ended = tuple(self._epochs)  # read once: the thread that pushes may add one at any time
        return (*ended, Epoch(_first_after(ended), self.frames - 1, None, None))

    @property
    def _first_of_epoch(self) -> int:
        return _first_after(self._epochs)

    @property
    def settings(self) -> Settings:
        """Settings of the method."""
        return self._settings

    @property
    def correct_lag(self) -> LagChoice:
        """What is done about a lag of the exposures."""
        return self._exposures.choice

    @property
    def pixels(self) -> PixelStatistics:
        """Statistics of the grey values of the processed frames."""
        return self._pixels

    @property
    def evidence(self) -> ExposureEvidence | None:
        """Changes of brightness between consecutive processed frames; None before the first frame."""
        return self._exposures.evidence

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
            correct_lag=str(self.correct_lag),
            size=self._size,
            max_grey=self._max_grey,
            exposures=self._exposures.state(),
            sampler=self._sampler,
            pixels=self._pixels,
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
        self._sampler, self._pixels = state.sampler, state.pixels
        self._skipped, self._reasons = state.skipped, state.reasons
        self._first_reasons, self._first_frames = state.first_reasons, state.first_frames
        self._epochs = [epoch_of(content) for content in state.epochs]
        self._exposures.restore(state.exposures, state.size, self._first_of_epoch)
        if self._exposures.evidence is not None:
            self._method = self._settings.build(state.size, state.max_grey)
            self._method.restore(method_state)
        self._foresee()

    @property
    def wanted(self) -> frozenset[int]:
        """Numbers of the frames that an engine just restored should be shown again."""
        if self._method is None or self._exposures.evidence is None:
            return frozenset()
        return self._method.wanted | self._exposures.evidence.wanted

    def recall(self, frame: Frame) -> None:
        """Process a frame again that new ones were being compared with.

        Raises
        ------
        FrameError
            If its image cannot be read any more, or has another size.
        """
        if self._method is not None and self._exposures.evidence is not None:
            shown = replace(frame, load=partial(_of_size, frame, self._size))
            prepared = self._preprocess(shown, self._pixels.range_before(frame.index))
            self._method.recall(prepared)
            self._exposures.evidence.recall(prepared.thumbnail)

    # The steps of push.

    def _change_of_lag(self, other: Change | None) -> Change | None:
        """Return a change of the frames that the exposures belong to; it may explain another change of the camera."""
        found = self._exposures.change_of_lag(explains=other is not None)
        if found is None:
            return None
        late = lag_in_words(found.later_frames)
        text = f"the exposures are written {late} compared with before, since about frame {found.frame}"
        return Change(found.frame, self.frames - 1, "exposures", text)

    def _begin_epoch(self, method: Method, change: Change) -> Method:
        """End the epoch with the calibration before a change of the camera, and go on with what came after it."""
        first, later = self._first_of_epoch, method.split(change.frame)
        found, exposures = self._exposures.split(change.frame)
        known = method.calibration(exposures, self._pixels.range_before(change.frame))
        ended = self._judged(known, found, change.frame - first)
        self._epochs.append(Epoch(first, change.frame - 1, ended, change))
        self._pixels = self._pixels.of_next_epoch()
        self._method = later
        self._sampler.restart()
        return later

    def _check(self, frame: Frame) -> None:
        if frame.colour and frame.image.ndim != 2:
            raise FrameError(f"{frame.name}: is in colour; open the recording with one of its channels")
        _check_exposure(frame.exposure_ms, frame.name)
        # Most frames need not be decoded; that one is missing or cut off is found out nevertheless.
        if frame.verify is not None:
            frame.verify()
        elif self._method is not None:
            _of_size(frame, self._size)
        if self._method is not None and frame.max_grey != self._max_grey:
            raise FrameError(
                f"{frame.name}: its largest grey value is {frame.max_grey}, but that of the first frame "
                f"{self._max_grey}; calibrate each bit depth on its own"
            )
        if frame.mask is not None:
            _check_mask(frame.mask, self._size_of(frame), frame.name)

    def _size_of(self, frame: Frame) -> ImageSize:
        return self._size if self._method is not None else (frame.image.shape[1], frame.image.shape[0])

    def _started(self, frame: Frame) -> Method:
        """Return the method, made for frames like the first."""
        if self._method is None:
            size = self._size_of(frame)
            self._method = self._settings.build(size, frame.max_grey)
            self._exposures.begin(size)
            self._size, self._max_grey = size, frame.max_grey
        return self._method

    def _foresee(self) -> None:
        """Leave a copy of what decides on the next frames, for threads that must not wait."""
        every = self._method is not None and self._method.longest_pause == 0
        self._foresight.expect(self._sampler, self._size, every=every)

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

    # The result of the frames so far.

    def _judged(self, known: Calibration, found: ExposureFindings, frames: int) -> Calibration:
        """Return the calibration from so many frames with the verdicts that their exposures allow."""
        found = found.doubted_by(known.effects)
        verdicts = {name: found.judged(verdict) for name, verdict in known.verdicts.items()}
        advice = (found.verdict.remedy, *known.advice) if found.warnings else known.advice
        source: dict[str, Any] = {"exposure_lag_frames": found.lag_frames}
        if found.corrected_frames:
            source["exposure_lag_corrected_frames"] = found.corrected_frames
        return replace(
            known,
            verdicts=verdicts | {"exposures": found.verdict},
            converged=known.converged and not found.warnings,
            counts={"frames": frames, "skipped": self._skipped, **known.counts},
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


def _first_after(ended: Sequence[Epoch]) -> int:
    """Return the first frame of the epoch that follows those that ended."""
    return ended[-1].last_frame + 1 if ended else 0


def _check_exposure(exposure_ms: float, name: str) -> None:
    if not (np.isfinite(exposure_ms) and exposure_ms > 0):
        raise ExposureError(f"{name}: exposure {exposure_ms} ms is not a positive number")


def _check_mask(mask: BoolArray, size: ImageSize, name: str) -> None:
    """Check that a mask has the size of the frames, and leaves something of them; FrameError if not."""
    height, width = mask.shape
    if (width, height) != size:
        raise FrameError(
            f"{name}: its mask has {width}×{height} pixels, but the frames have {size[0]}×{size[1]}; make them equal"
        )
    if not mask.any():
        raise FrameError(f"{name}: its mask leaves no pixel; True is where pixels may be used")


def _of_size(frame: Frame, size: ImageSize) -> Image:
    """Return a frame's image, or say that it has another size than the first."""
    height, width = frame.image.shape
    if (width, height) != size:
        raise FrameError(
            f"{frame.name}: {width}×{height} pixels, but the first frame has {size[0]}×{size[1]}; "
            "calibrate each image size on its own"
        )
    return frame.image
