"""Recordings without exposures: estimated from the images, up to one exponent."""

from ospc.unknown_exposures.recovery import (
    EXPONENT_SIGMA,
    MOST_FRAMES,
    RecoveredRecording,
    calibrate_without_exposures,
    labelled,
    recover_exposures,
    typical_exponent,
)

__all__ = [
    "EXPONENT_SIGMA",
    "MOST_FRAMES",
    "RecoveredRecording",
    "calibrate_without_exposures",
    "labelled",
    "recover_exposures",
    "typical_exponent",
]
