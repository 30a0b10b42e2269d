"""A recording as its calibration used it: each exposure at its own frame, corrected, and without wrong ones."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from ospc.arrays import FloatArray, numbers_of
from ospc.errors import ExposureError, counted
from ospc.exposures.findings import ExposureFindings
from ospc.exposures.lag_choice import lag_in_words
from ospc.exposures.table import ExposureTable, filled
from ospc.photometry.calibration import Calibration
from ospc.recording import Recording
from ospc.recording.derived import DerivedRecording
from ospc.recording.recording import frames_sha256

_LAG, _WRONG = "exposure_lag_corrected_frames", "exposures_ignored_of_frames"
_EARLIER_LAGS = "exposure_lags_corrected_until"
"""The frames before which other lags were corrected, in order, each with its lag."""
_CORRECTED = "exposures_corrected_ms"
"""Some of the recorded exposures, in ascending order, and what they were corrected to."""


def as_source(found: ExposureFindings) -> dict[str, Any]:
    """Return what the ``source`` of a calibration states about its exposures."""
    source: dict[str, Any] = {"exposure_lag_frames": found.lag.frames}
    if found.corrected_frames:
        source[_LAG] = found.corrected_frames
    if found.evidence.wrong:
        source[_WRONG] = list(found.evidence.wrong)
    return source


def corrected_as_source(recorded_ms: FloatArray, corrected_ms: FloatArray) -> dict[str, Any]:
    """Return what the ``source`` of a calibration states about exposures that a fit corrected.

    The recorded exposures, in ascending order, and the corrected ones have shape (n,).
    """
    return {_CORRECTED: [recorded_ms.tolist(), corrected_ms.tolist()]}


def with_earlier_exposures(
    source: Mapping[str, Any], ended: Iterable[tuple[int, int, Sequence[int]]]
) -> dict[str, Any]:
    """Return a ``source`` that also states what is known of the exposures before changes of the camera.

    ``ended`` has the first frame after each change, the lag that was corrected before, and the frames before whose
    exposures were ignored.
    """
    lags, wrong = [], list(source.get(_WRONG, ()))
    for until, lag, ignored in ended:
        lags.append([until, lag])
        wrong += ignored
    found = dict(source)
    if any(lag != source.get(_LAG, 0) for _, lag in lags):
        found[_EARLIER_LAGS] = lags
    if wrong:
        found[_WRONG] = sorted(wrong)
    return found


def _wrong(calibration: Calibration, count: int) -> list[int]:
    """Return the frames whose exposures were ignored, of a recording with ``count`` frames."""
    stated = calibration.source.get(_WRONG, ())
    frames = stated if isinstance(stated, list | tuple) else ()
    return [frame for frame in frames if isinstance(frame, int) and 0 <= frame < count]


def used_exposures(calibration: Calibration, exposures_ms: FloatArray) -> FloatArray:
    """Return the exposure of every frame of a recording as its calibration used it, shape (frames,), NaN if unknown.

    Each is moved to the frame that it belongs to, and errors that depend on the exposure alone, such as a constant
    offset, are corrected. Those that are wrong or not recorded, such as the last ones if exposures are recorded late,
    are unknown.
    """
    count = len(exposures_ms)
    lags, wrong = _lags_until(calibration, count), _wrong(calibration, count)
    if not (wrong or any(lag for _, lag in lags)) or any(abs(lag) >= count for _, lag in lags):
        return _corrected(calibration, exposures_ms)
    known = np.where(np.isfinite(exposures_ms) & (exposures_ms > 0), exposures_ms, np.nan)
    first, found = 0, list[FloatArray]()
    for until, lag in lags:
        table = ExposureTable.of(np.log(known), lag).without(wrong)
        found.append(table.log_exposure_of(np.arange(first, until)))
        first = until
    return _corrected(calibration, np.exp(np.concatenate(found)))


def _corrected(calibration: Calibration, exposures_ms: FloatArray) -> FloatArray:
    """Return exposures without the errors that the calibration corrected; the input itself if there are none."""
    table = numbers_of(calibration.source.get(_CORRECTED, ()))
    if table is None or table.ndim != 2 or len(table) != 2 or not table.size or not np.all(np.isfinite(table)):
        return exposures_ms
    recorded_ms, corrected_ms = table
    if not np.all(np.diff(recorded_ms) > 0):
        return exposures_ms
    missing_ms = np.interp(exposures_ms, recorded_ms, corrected_ms - recorded_ms)
    return np.asarray(np.where(exposures_ms > 0, exposures_ms + missing_ms, exposures_ms))


def _lags_until(calibration: Calibration, count: int) -> list[tuple[int, int]]:
    """Return the lags that were corrected in a recording with ``count`` frames, and the frames before which."""
    stated = calibration.source.get(_EARLIER_LAGS, ())
    found = list[tuple[int, int]]()
    for entry in stated if isinstance(stated, list | tuple) else ():
        match entry:
            case [int(until), int(lag)] if (found[-1][0] if found else 0) < until < count:
                found.append((until, lag))
    lag = calibration.source.get(_LAG, 0)
    return [*found, (count, lag if isinstance(lag, int) else 0)]


def without_gaps(exposures_ms: FloatArray) -> FloatArray:
    """Return exposures with unknown ones interpolated; at either end, they equal the nearest known one.

    The input itself is returned if all are known or none is.
    """
    known = np.isfinite(exposures_ms) & (exposures_ms > 0)
    if known.all() or not known.any():
        return exposures_ms
    return np.asarray(np.exp(filled(np.log(np.where(known, exposures_ms, np.nan)))))


def with_used_exposures(recording: Recording, calibration: Calibration | None) -> Recording:
    """Return a recording with the exposures that its calibration used, without gaps, and a note.

    Without a calibration, with one from another recording, or if exposures were used as recorded, the recording
    itself is returned.
    """
    if calibration is None or not _is_from(calibration, recording):
        return recording
    exposures_ms = used_exposures(calibration, recording.exposures_ms)
    if exposures_ms is recording.exposures_ms:
        return recording
    exposures_ms = without_gaps(exposures_ms)
    note = use_of_exposures(recording, calibration)
    return DerivedRecording.of(recording, np.arange(len(recording)), exposures_ms, note=note)


def check_exposures_fit(recording: Recording, calibration: Calibration | None) -> None:
    """Raise an ExposureError if a calibration is from estimated exposures, and the recording has others that vary."""
    if calibration is None or not calibration.exponent_sigma or _is_from(calibration, recording):
        return
    exposures_ms = recording.exposures_ms
    if np.unique(exposures_ms[np.isfinite(exposures_ms)]).size > 1:
        raise ExposureError(
            f"{recording.path}: its exposures do not fit the calibration, which is from estimated ones and known "
            "only up to one exponent; give the images that were calibrated with the times.txt of the calibration, or "
            "calibrate with known exposures"
        )


def use_of_exposures(recording: Recording, calibration: Calibration) -> str:
    """Return a note on exposures that :func:`with_used_exposures` changes, or that may have to be; else empty."""
    late, wrong = _course(_lags_until(calibration, len(recording))), _wrong(calibration, len(recording))
    if _is_from(calibration, recording):
        moved = f"{late} and are moved to their frames" if late else ""
        ignored = f"{counted(len(wrong), 'wrong exposure')} interpolated" if wrong else ""
        corrected = "exposures are corrected as the calibration states" if _CORRECTED in calibration.source else ""
        return "; ".join(filter(None, (moved, ignored, corrected)))
    if not late:
        return ""
    return f"in the recording of the calibration, {late}; those of {recording.path.name} are used as recorded"


def _course(lags: Sequence[tuple[int, int]]) -> str:
    """Return how exposures were recorded, as text; empty if it was always with their frames."""
    if not any(lag for _, lag in lags):
        return ""
    each = [lag_in_words(lag) if lag else "with their frames" for _, lag in lags]
    before = [f"{how} before frame {until}" for how, (until, _) in zip(each[:-1], lags, strict=False)]
    return f"exposures were recorded {', then '.join([*before, each[-1]])}"


def _is_from(calibration: Calibration, recording: Recording) -> bool:
    """Return whether a calibration was made from this recording: its frames have the same stamps and exposures."""
    return calibration.source.get("frames_sha256") == frames_sha256(recording)
