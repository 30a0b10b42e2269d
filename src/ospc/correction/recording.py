"""Correction of a recording: images are corrected one by one and written to a folder."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path, PurePosixPath

import numpy as np

from ospc.arrays import FloatArray
from ospc.correction.folder import CorrectedFolder, Counts
from ospc.correction.settings import CorrectionSettings
from ospc.correction.source import Source, ids_for
from ospc.errors import ExposureError, FrameError, NotObservableError, RecordingError, SettingError
from ospc.exposures.table import range_in_words
from ospc.exposures.used import check_exposures_fit, use_of_exposures, with_used_exposures, without_gaps
from ospc.formats.dso import parameter_files, write_times
from ospc.formats.image_header import JPEG_START, WITH_METADATA, read_header
from ospc.formats.opening import Photometry
from ospc.photometry.correction import Corrector, wrong_size
from ospc.photometry.response import Response
from ospc.photometry.vignette import RasterVignette, unknown_part_in_words
from ospc.recording import Frame, Recording, identity
from ospc.recording.derived import with_sensor_depth
from ospc.recording.frame_table import NO_EXPOSURES, NO_STAMPS
from ospc.recording.image_formats import format_of
from ospc.recording.image_sequence import ImageSequence
from ospc.recording.stream import mapped, usable_frames

_DEFAULT = CorrectionSettings()
_REASONS_KEPT = 20
"""Number of reasons for unreadable frames that are kept; more are rarely useful."""

_KEPT_8_BIT = frozenset({".png", ".jpg", ".jpeg", ".tif", ".tiff"})
_KEPT_16_BIT = frozenset({".png", ".tif", ".tiff"})
"""Formats that re-encoded images keep; others become PNG."""

_WITH_ALPHA = (2, 4)
"""Numbers of channels of images with an alpha channel; a JPEG file with four has none."""

_WIDE = 4.0
"""Ratio of exposures above which 8-bit output at one scale loses two of its bits."""


@dataclass(frozen=True)
class Corrected:
    """The outcome of a correction."""

    path: Path
    """The folder."""
    formula: str
    """The meaning of a pixel value as a sentence."""
    frames: tuple[int, ...]
    """Indices of the written frames."""
    exposures_ms: FloatArray
    """Exposures of their images, shape (frames,); all 1 ms if unknown."""
    skipped: int
    """Number of frames that could not be read or have no exposure."""
    reasons: tuple[str, ...]
    """Reasons for the first few of them."""
    saturated: float
    """Share of the pixels that were saturated."""
    clipped: float
    """Share of the pixels that are not saturated but exceed the range of the output."""
    assumed: tuple[str, ...]
    """Names of the unknown parts of the calibration, which were replaced by the identity."""
    notes: tuple[str, ...]
    """Other notes for the user."""
    kept: int = 0
    """Number of frames that an interrupted correction had already written."""


def corrector_for(recording: Recording, photometry: Photometry, *, assume_missing: bool = False) -> Corrector:
    """Return the corrector for the images of a recording.

    Raises
    ------
    SettingError
        If the vignette is for images of another size.
    NotObservableError
        If response or vignette is unknown, unless ``assume_missing``.
    """
    for part, means in (("response", "linear"), ("vignette", "flat")):
        if getattr(photometry, part) is None and not assume_missing:
            verdict = None if photometry.calibration is None else photometry.calibration.verdicts.get(part)
            reason = "" if verdict is None else f": {verdict.reason}"
            raise NotObservableError(
                f"{photometry.name}: has no {part}{reason}; use a calibration that has one, or add --assume-missing "
                f"to assume that it is {means}"
            )
    if photometry.vignette is not None and photometry.vignette.size != recording.size:
        raise SettingError(
            wrong_size(f"every image of {recording.path}", recording.size, photometry.name, photometry.vignette.size)
        )
    return Corrector(photometry.response, photometry.vignette, recording.max_grey, assume_missing)


def correct_recording(
    source: Source,
    photometry: Photometry,
    folder: CorrectedFolder,
    settings: CorrectionSettings = _DEFAULT,
    progress: Callable[[int, int], None] = lambda _done, _total: None,
) -> Corrected:
    """Write images corrected for response and vignette, with the names of the originals.

    Images are read one by one, and corrected and written by several threads; only a few are in memory at a time.
    Images that an interrupted correction has written are kept if everything they depend on is the same.

    ``progress`` is called with the number of finished frames and the total. ``correction.json`` in the folder has the
    returned values and more. Integer output also gets a pcalib.txt and a vignette.png that describe the corrected
    images.

    Raises
    ------
    SettingError
        If the calibration is for images of another size, or the folder cannot be written.
    NotObservableError
        If response or vignette is unknown, unless ``settings.assume_missing``.
    ExposureError
        If exposures are to be normalised but are unknown or do not fit the calibration.
    RecordingError
        If no image can be read.
    """
    recording = with_sensor_depth(source.recording, photometry.max_grey)
    corrector = corrector_for(recording, photometry, assume_missing=settings.assume_missing)
    if settings.normalise_exposure:
        if source.unexposed is not None:
            raise ExposureError(f"{source.unexposed}; or leave out --normalise-exposure, which needs exposures")
        check_exposures_fit(recording, photometry.calibration)
    known = with_used_exposures(recording, photometry.calibration)
    exposures_ms = known.exposures_ms
    settings = settings.for_images(recording.max_grey, exposures_ms)
    notes = list(_notes_on(source, recording, photometry, settings))
    note = {
        "formula": settings.formula,
        "settings": vars(settings),
        "calibration": photometry.name,
        "calibration_sha256": _sha256(photometry),
        "assumed_identity": list(corrector.assumed),
        "recording": identity(recording),
        "notes": notes,
    }
    names = _output_names(source, settings)
    done = folder.begin(note, names)
    counts = dict(done)
    reasons: list[str] = []
    work = _Work(source, corrector, folder, settings, names)
    # Without a reference, exposures do not matter: frames with unknown ones are corrected too.
    needed = settings.reference_ms is not None
    left = (f if needed else replace(f, exposure_ms=1.0) for f in known if f.index not in done)
    for index, counted in mapped(work, usable_frames(left, reasons.append)):
        folder.mark_written(index, counted)
        counts[index] = counted
        progress(len(counts) + len(reasons), len(recording))
    if not counts:
        raise RecordingError(f"{recording.path}: no image can be read; {reasons[0]}")
    values, saturated, clipped = (sum(column) for column in zip(*counts.values(), strict=True))
    if values > len(counts) * recording.size[0] * recording.size[1]:
        notes.append("images are in colour: response and vignette are applied to each channel")
    frames = sorted(counts)
    exposures_ms = exposures_ms[frames]
    result = Corrected(
        path=folder.path,
        formula=settings.formula,
        frames=tuple(frames),
        exposures_ms=exposures_ms if settings.reference_ms is None else np.full(len(frames), settings.reference_ms),
        skipped=len(reasons),
        reasons=tuple(reasons[:_REASONS_KEPT]),
        saturated=saturated / values,
        clipped=clipped / values,
        assumed=corrector.assumed,
        notes=tuple(notes),
        kept=len(done),
    )
    files = [names[index] for index in frames]
    work.describe(files, result)
    facts = {
        "frames": len(frames),
        "skipped": {"frames": result.skipped, "reasons": list(result.reasons)},
        "saturated_share": result.saturated,
        "clipped_share": result.clipped,
        "original_exposures_ms": None if source.unexposed else exposures_ms.tolist(),
        "copied": folder.copy_geometry(recording),
    }
    folder.finish(note | facts, files)
    return result


def _output_names(source: Source, settings: CorrectionSettings) -> list[PurePosixPath]:
    """Return the names of the corrected images: those of the originals, with another suffix if needed."""
    kept = {None: set(), 255: _KEPT_8_BIT, 65535: _KEPT_16_BIT}[settings.limit if settings.keep_response else None]
    other = ".tiff" if settings.limit is None else ".png"
    originals = source.names()
    names = [name if name.suffix.lower() in kept else name.with_suffix(other) for name in originals]
    if len(set(names)) == len(names):
        return names
    # Some names only differ in their suffix, such as a photograph and its raw file.
    return [
        name if name == original else original.with_name(original.name + other)
        for name, original in zip(names, originals, strict=True)
    ]


def _sha256(photometry: Photometry) -> str:
    """Return a hash of response and vignette."""
    response, vignette = photometry.response, photometry.vignette
    table = b"" if response is None else response.inverse_table.tobytes()
    return sha256(table + (b"" if vignette is None else vignette.image().tobytes())).hexdigest()


def _notes_on(
    source: Source, recording: Recording, photometry: Photometry, settings: CorrectionSettings
) -> Iterator[str]:
    """Yield remarks that the user should read before using the result."""
    if photometry.max_grey not in (None, recording.max_grey):
        yield (
            f"the calibration is for grey values up to {photometry.max_grey}; its response is stretched to the "
            f"grey values of the recording, up to {recording.max_grey}"
        )
    if photometry.caveat:
        yield photometry.caveat
    if unknown := unknown_part_in_words(photometry.vignette):
        yield unknown
    if photometry.calibration and (note := use_of_exposures(recording, photometry.calibration)):
        yield note
    if _has_alpha(source.recording):
        yield "images have an alpha channel, which is not written"
    low, high = np.nanmin(recording.exposures_ms), np.nanmax(recording.exposures_ms)
    if settings.output == "grey8" and settings.normalise_exposure and high > _WIDE * low:
        yield (
            f"8 bits are too few for exposures from {range_in_words(low, high)} on one scale; use grey16 or "
            f"irradiance"
        )
    yield from (n for n in recording.notes if source.unexposed is None or not n.endswith((NO_EXPOSURES, NO_STAMPS)))


def _has_alpha(recording: Recording) -> bool:
    """Return whether the first image has an alpha channel."""
    if not isinstance(recording, ImageSequence) or format_of(recording.names[0]) is not None:
        return False
    with suppress(FrameError):
        data = recording.stored_bytes(0)
        return not data.startswith(JPEG_START) and read_header(data, recording.names[0]).channels in _WITH_ALPHA
    return False


@dataclass(frozen=True)
class _Work:
    """Corrects and writes one image; returns its index and counts."""

    source: Source
    corrector: Corrector
    folder: CorrectedFolder
    settings: CorrectionSettings
    names: Sequence[PurePosixPath]

    def __call__(self, frame: Frame) -> tuple[int, Counts]:
        image, settings = frame.image, self.settings
        correct = self.corrector.without_vignette if settings.keep_response else self.corrector.correct
        corrected = correct(
            image,
            None if settings.reference_ms is None else frame.exposure_ms / settings.reference_ms,
            dtype=settings.dtype,
            white=settings.white,
            mark_saturated=settings.mask_saturated,
        )
        name = self.names[frame.index]
        original = self._original(frame.index) if name.suffix.lower() in WITH_METADATA else b""
        self.folder.write_image(name, corrected, original, self.source.modified_ns(frame.index))
        saturated = self.corrector.saturated(image)
        clipped = 0
        if settings.limit is not None:
            clipped = int(np.count_nonzero((corrected == settings.limit) & ~saturated))
        return frame.index, Counts(image.size, int(np.count_nonzero(saturated)), clipped)

    def describe(self, files: Sequence[PurePosixPath], result: Corrected) -> None:
        """Write files that describe the images to other programs: parameters, time stamps, exposures."""
        recording, limit = self.source.recording, self.settings.limit
        if limit is not None:
            kept = self.corrector.response if self.settings.keep_response else None
            linear = Response(np.linspace(0.0, 1.0, 256), model={"name": "linear"})
            flat = RasterVignette(np.ones(recording.size[::-1], np.float32))
            for name, write in parameter_files(kept if isinstance(kept, Response) else linear, flat, limit):
                write(self.folder.path / name)
        ids = ids_for(files)
        numbered = np.array_equal(recording.stamps_s, np.arange(len(recording)))
        if ids is None or (self.source.unexposed and numbered):
            return  # there are no time stamps, or a list could not assign them to these names
        exposures_ms = None if self.source.unexposed else without_gaps(result.exposures_ms)
        write_times(self.folder.path / "times.txt", ids, recording.stamps_s[list(result.frames)], exposures_ms)

    def _original(self, index: int) -> bytes:
        """Return the file of an image, or its EXIF, from which metadata is copied."""
        recording = self.source.recording
        if not isinstance(recording, ImageSequence):
            return b""
        data, optional = recording.stored_bytes(index), format_of(recording.names[index])
        return data if optional is None else optional.exif(data)
