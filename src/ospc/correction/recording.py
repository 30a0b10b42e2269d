"""Correct a recording image by image and write it as another."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from ospc.arrays import FloatArray, Image
from ospc.correction.folder import CorrectedFolder
from ospc.correction.settings import DTYPES, CorrectionSettings
from ospc.correction.threads import mapped
from ospc.errors import FrameError, NotObservableError, RecordingError, SettingError
from ospc.formats.opening import Photometry
from ospc.photometry.correction import Corrector, wrong_size
from ospc.recording import Frame, Recording, identity

_DEFAULT = CorrectionSettings()
_REASONS_KEPT = 20
"""Reasons for unreadable frames that are kept; thousands of equal ones help nobody."""


_WIDE = 4.0
"""Ratio of exposures above which 8-bit output at one scale loses two of its bits."""


@dataclass(frozen=True)
class Corrected:
    """The outcome of a correction.

    Attributes
    ----------
    path
        The folder that was written.
    formula
        The meaning of a pixel value, as a sentence.
    frames
        Indices of the written frames; also their numbers in times.txt and their file names.
    exposures_ms
        Exposures of the corrected images, shape (frames,).
    skipped
        Number of frames that could not be read.
    reasons
        Why, for the first few of them.
    saturated
        Share of the pixels that were saturated.
    clipped
        Share of the other pixels that exceed the range of the output.
    assumed
        Names of the unknown parts of the calibration, which were taken to be the identity.
    notes
        Further remarks for the user.
    """

    path: Path
    formula: str
    frames: tuple[int, ...]
    exposures_ms: FloatArray
    skipped: int
    reasons: tuple[str, ...]
    saturated: float
    clipped: float
    assumed: tuple[str, ...]
    notes: tuple[str, ...]


def corrector_for(recording: Recording, photometry: Photometry, *, assume_missing: bool = False) -> Corrector:
    """Return the corrector for the images of a recording.

    Raises
    ------
    SettingError
        If the vignette is for images of another size.
    NotObservableError
        If response or vignette is unknown and not assumed to be the identity.
    """
    for part, means in (("response", "linear"), ("vignette", "none")):
        if getattr(photometry, part) is None and not assume_missing:
            verdict = None if photometry.calibration is None else photometry.calibration.verdicts.get(part)
            reason = "" if verdict is None else f" ({verdict.reason})"
            raise NotObservableError(
                f"{photometry.name}: has no {part}{reason}; give a calibration that has one, or add --assume-missing "
                f"to take it as {means}"
            )
    if photometry.vignette is not None and photometry.vignette.size != recording.size:
        raise SettingError(
            wrong_size(f"every image of {recording.path}", recording.size, photometry.name, photometry.vignette.size)
        )
    return Corrector(photometry.response, photometry.vignette, recording.max_grey, assume_missing)


def correct_recording(
    recording: Recording,
    photometry: Photometry,
    folder: CorrectedFolder,
    settings: CorrectionSettings = _DEFAULT,
    progress: Callable[[int, int], None] = lambda _done, _total: None,
) -> Corrected:
    """Write a recording whose images are corrected for response and vignette.

    Images are read one by one, and corrected and written by a few threads; only a few are in memory at a time.

    Parameters
    ----------
    recording
        The recording to correct.
    photometry
        Response and vignette of its camera.
    folder
        The output folder.
    settings
        The kind of output.
    progress
        Called with the number of frames done and the number of all frames.

    Returns
    -------
    Corrected
        What was written; ``correction.json`` in the folder has the same and more. ``grey8`` and ``grey16`` also get
        a pcalib.txt and a vignette.png that describe the corrected images: linear, without vignette.

    Raises
    ------
    SettingError
        If the calibration is for images of another size, or the folder cannot be written.
    NotObservableError
        If response or vignette is unknown and not assumed to be the identity.
    RecordingError
        If no image can be read.
    """
    corrector = corrector_for(recording, photometry, assume_missing=settings.assume_missing)
    reference_ms = settings.reference_for(recording.exposures_ms)
    notes = tuple(_notes_on(recording, photometry, settings))
    note = {
        "formula": settings.formula(reference_ms),
        "settings": vars(settings) | {"reference_ms": reference_ms},
        "calibration": photometry.name,
        "assumed_identity": list(corrector.assumed),
        "recording": identity(recording),
        "notes": list(notes),
    }
    folder.begin({"finished": False, **note})
    reasons: list[str] = []
    written: list[_Written] = []
    for done in mapped(_Work(corrector, folder, settings, reference_ms), _readable(recording, reasons)):
        written.append(done)
        progress(len(written) + len(reasons), len(recording))
    if not written:
        raise RecordingError(f"{recording.path}: none of its {len(recording)} images can be read; {reasons[0]}")
    pixels = len(written) * recording.size[0] * recording.size[1]
    frames = [w.index for w in written]
    result = Corrected(
        path=folder.path,
        formula=settings.formula(reference_ms),
        frames=tuple(frames),
        exposures_ms=recording.exposures_ms[frames] if reference_ms is None else np.full(len(frames), reference_ms),
        skipped=len(reasons),
        reasons=tuple(reasons[:_REASONS_KEPT]),
        saturated=sum(w.saturated for w in written) / pixels,
        clipped=sum(w.clipped for w in written) / pixels,
        assumed=corrector.assumed,
        notes=notes,
    )
    if settings.limit is not None:
        folder.write_linear_parameters(recording.size, settings.limit)
    folder.write_note(
        {
            "finished": True,
            **note,
            "frames": len(frames),
            "skipped": {"frames": result.skipped, "reasons": list(result.reasons)},
            "saturated_share": result.saturated,
            "clipped_share": result.clipped,
            "original_exposures_ms": recording.exposures_ms[frames].tolist(),
            "copied": folder.copy_geometry(recording.path),
        }
    )
    # Last, for it makes the folder a recording.
    folder.write_times(frames, recording.stamps_s[frames], result.exposures_ms)
    return result


def _notes_on(recording: Recording, photometry: Photometry, settings: CorrectionSettings) -> Iterator[str]:
    """Yield remarks that the user should read before using the result."""
    calibrated = None if photometry.calibration is None else photometry.calibration.max_grey
    if calibrated not in (None, recording.max_grey):
        yield (
            f"the calibration was made with grey values up to {calibrated}; its response is stretched to those of "
            f"the recording, up to {recording.max_grey}"
        )
    low, high = np.min(recording.exposures_ms), np.max(recording.exposures_ms)
    if settings.output == "grey8" and settings.normalise_exposure and high > _WIDE * low:
        yield (
            f"8 bits are too few for exposures from {low:.3g} to {high:.3g} ms at one scale; use grey16 or irradiance"
        )
    yield from recording.notes


@dataclass(frozen=True)
class _Written:
    """One written frame: how many pixels were saturated, and how many others exceed the range of the output."""

    index: int
    saturated: int
    clipped: int


@dataclass(frozen=True)
class _Work:
    """Corrects and writes one image."""

    corrector: Corrector
    folder: CorrectedFolder
    settings: CorrectionSettings
    reference_ms: float | None

    def __call__(self, item: tuple[Frame, Image]) -> _Written:
        frame, image = item
        corrected = self.corrector.correct(
            image,
            None if self.reference_ms is None else frame.exposure_ms / self.reference_ms,
            dtype=DTYPES[self.settings.output],
            white=self.settings.white,
            mark_saturated=self.settings.mask_saturated,
        )
        self.folder.write_image(frame.index, corrected)
        saturated = cv2.compare(image, float(self.corrector.max_grey), cv2.CMP_GE)
        clipped = 0
        if self.settings.limit is not None:
            white = cv2.compare(corrected, float(self.settings.limit), cv2.CMP_EQ)
            clipped = cv2.countNonZero(cv2.subtract(white, saturated))
        return _Written(frame.index, cv2.countNonZero(saturated), clipped)


def _readable(recording: Recording, reasons: list[str]) -> Iterator[tuple[Frame, Image]]:
    """Yield the readable frames with their images, and collect the reasons for the others."""
    for frame in recording:
        try:
            image = frame.image
        except FrameError as error:
            reasons.append(str(error))
            continue
        yield frame, image
