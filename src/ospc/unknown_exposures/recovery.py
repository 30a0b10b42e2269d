"""Calibrate recordings without exposures, up to one exponent, which all outputs state.

With free exposures, g^γ, V^γ and e^γ explain any recording equally well for every γ > 0. Exposures are estimated
jointly with response and vignette (Bergmann, Wang, Cremers 2018). γ is then chosen such that the response is as close
as possible to the mean response of typical cameras, and the selected method runs with these exposures. The scatter of
cameras around the mean is the uncertainty of γ, which is added to all other uncertainties.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from itertools import islice

import numpy as np

from ospc.arrays import read_only
from ospc.errors import FrameError, NotObservableError, counted
from ospc.recording.derived import DerivedRecording
from ospc.recording.recording import Recording
from ospc.settings.unknown_exposures import EXPONENT_LEVELS, MAX_RECOVERED_FRAMES, RESPONSE_SAMPLES
from ospc.unknown_exposures.joint_estimation import JointEstimate, estimate_jointly
from ospc.unknown_exposures.response_model import learned_model
from ospc.unknown_exposures.tracking import GainRobustTracker


def recover_exposures(
    recording: Recording, progress: Callable[[int, int], None] = lambda _done, _all: None
) -> DerivedRecording:
    """Return a recording with exposures estimated from its images alone, relative to their median.

    They are known up to one exponent, and every calibration from them says so. Frames whose exposure cannot be
    estimated are left out. ``progress`` is called with the number of frames done and the total.

    NotObservableError if too little can be tracked between frames.
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
    exposures = read_only(np.array([float(f"{e:.9g}") for e in np.exp(log_e - np.median(log_e))]))  # as in times.txt
    missing = len(recording) - len(exposures)
    left_out = f"; {counted(missing, 'frame')} left out because no exposure was estimated" if missing else ""
    note = f"exposures are estimated from the images: relative, and up to one exponent{left_out}"
    return DerivedRecording.of(recording, found.frames, exposures, note=note, exposures_estimated=True)


def typical_exponent(found: JointEstimate) -> float:
    """Return the exponent γ for which ln g^γ is closest to the mean response, in least squares over grey levels."""
    x = np.linspace(0, 1, RESPONSE_SAMPLES)
    log_g = np.log(np.maximum(found.response.inverse(EXPONENT_LEVELS), 1e-6))
    log_mean = np.log(np.interp(EXPONENT_LEVELS, learned_model().mean, x))
    return float(log_g @ log_mean / (log_g @ log_g))
