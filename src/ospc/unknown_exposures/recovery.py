"""Calibrate recordings without exposures, up to one exponent, which all outputs state.

With free exposures, g^γ, V^γ and e^γ explain any recording equally well for every γ > 0. Exposures are estimated
jointly with response and vignette (Bergmann, Wang, Cremers 2018). γ is then chosen such that the response is as close
as possible to the mean response of typical cameras, and the selected method runs with these exposures. The scatter of
cameras around the mean is the uncertainty of γ, which is added to all other uncertainties.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np

from ospc.arrays import read_only
from ospc.calibrator import calibrate
from ospc.errors import FrameError, NotObservableError, counted
from ospc.photometry.calibration import PROFILE_RADII, Calibration
from ospc.photometry.verdict import Verdict
from ospc.photometry.vignette import diagonal_profile
from ospc.recording import open_recording
from ospc.recording.derived import DerivedRecording
from ospc.recording.options import ReadingOptions
from ospc.recording.recording import Recording
from ospc.settings import Settings
from ospc.settings.unknown_exposures import (
    EXPONENT_LEVELS,
    EXPONENT_SIGMA,
    MAX_RECOVERED_FRAMES,
)
from ospc.unknown_exposures.joint_estimation import JointEstimate, estimate_jointly
from ospc.unknown_exposures.response_model import SAMPLES, learned_model
from ospc.unknown_exposures.tracking import GainRobustTracker

_REMEDY = "give the exposure of every frame, or of a second recording of the same camera"


class RecoveredRecording(DerivedRecording):
    """A recording with exposures estimated from its images, relative to their median and up to an exponent."""


def recover_exposures(
    recording: Recording, progress: Callable[[int, int], None] = lambda _done, _all: None
) -> RecoveredRecording:
    """Return a recording with exposures estimated from its images alone, relative to their median.

    Frames whose exposure cannot be estimated are left out. ``progress`` is called with the number of frames done and
    the total. NotObservableError if too little can be tracked between frames.
    """
    tracker = GainRobustTracker(every=1)
    total = min(len(recording), MAX_RECOVERED_FRAMES)
    for done, frame in enumerate(islice(recording, total), start=1):
        # Unreadable frames are left out here; the calibration skips them too.
        with suppress(FrameError):
            tracker.push(frame)
        progress(done, total)
    try:
        found = estimate_jointly(tracker.observations())
    except NotObservableError as error:
        raise NotObservableError(
            f"{recording.path}: exposures cannot be estimated from its images: {error}"
        ) from None
    log_e = typical_exponent(found) * found.log_exposures
    exposures = read_only(np.exp(log_e - np.median(log_e)))
    missing = len(recording) - len(exposures)
    left_out = f"; {counted(missing, 'frame')} left out because no exposure was estimated" if missing else ""
    note = f"exposures are estimated from the images: relative, and up to one exponent{left_out}"
    return RecoveredRecording.of(recording, found.frames, exposures, note=note)


def calibrate_without_exposures(
    recording: Recording | str | Path, settings: Settings | str = "default"
) -> Calibration:
    """Calibrate the camera of a recording, or of the recording at a path, without using exposures.

    Response and vignette are known up to one common exponent, as verdicts and ``exponent_sigma`` state.

    NotObservableError if too little can be tracked between frames, RecordingError if the recording cannot be opened.
    """
    if isinstance(recording, str | Path):
        recording = open_recording(recording, options=ReadingOptions(unknown_exposures=True))
    recovered = recover_exposures(recording)
    return labelled(calibrate(recovered, settings, correct_lag="trusted"), recovered)


def typical_exponent(found: JointEstimate) -> float:
    """Return the exponent γ for which ln g^γ is closest to the mean response, in least squares over grey levels."""
    x = np.linspace(0, 1, SAMPLES)
    log_g = np.log(np.maximum(found.response.inverse(EXPONENT_LEVELS), 1e-6))
    log_mean = np.log(np.interp(EXPONENT_LEVELS, learned_model().mean, x))
    return float(log_g @ log_mean / (log_g @ log_g))


def labelled(calibration: Calibration, recording: object) -> Calibration:
    """Return the calibration; if the exposures were estimated, label it and add the uncertainty of the exponent."""
    if not isinstance(recording, RecoveredRecording):
        return calibration
    response, vignette_sigma, sigma = calibration.response, calibration.vignette_sigma, EXPONENT_SIGMA
    if response is not None:
        log_g = np.log(np.maximum(response.inverse_table, 1e-12))
        log_reference = float(np.log(response.inverse(response.reference_grey)))
        known = 0.0 if response.log_sigma is None else np.asarray(response.log_sigma)
        response = replace(
            response,
            log_sigma=np.hypot(known, np.abs(log_g - log_reference) * sigma),
            scale_sigma=float(np.hypot(response.scale_sigma or 0.0, log_reference * sigma)),
        )
    if calibration.vignette is not None and vignette_sigma is not None:
        profile = diagonal_profile(calibration.vignette, PROFILE_RADII)
        vignette_sigma = np.hypot(vignette_sigma, np.abs(profile * np.log(np.maximum(profile, 1e-12))) * sigma)
    verdicts = {name: _labelled_verdict(name, verdict) for name, verdict in calibration.verdicts.items()}
    return replace(
        calibration,
        response=response,
        vignette_sigma=vignette_sigma,
        verdicts=verdicts,
        converged=False,
        exponent_sigma=sigma,
        advice=(_REMEDY, *calibration.advice),
    )


def _labelled_verdict(name: str, verdict: Verdict) -> Verdict:
    if not verdict.known:
        return replace(verdict, reason=f"{verdict.reason} (exposures are estimated: their unit is arbitrary)")
    others = " and ".join(part for part in ("response", "vignette", "exposures") if part != name)
    return Verdict(
        "marginal",
        f"up to one exponent: no exposures were known, and raising {name}, {others} to any common power explains the "
        f"images equally well; the power is that of a typical camera (ln γ ± {EXPONENT_SIGMA:.2f})",
        _REMEDY,
    )
