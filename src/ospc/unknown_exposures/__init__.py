"""Recordings without exposures: estimate everything from the images, up to one exponent."""

from ospc.unknown_exposures.recovery import calibrate_without_exposures, labelled, recover_exposures

__all__ = ["calibrate_without_exposures", "labelled", "recover_exposures"]
