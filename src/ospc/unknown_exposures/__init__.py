"""Recordings without exposures: estimate everything from the images, up to one exponent."""

from ospc.unknown_exposures.recovery import recover_exposures

__all__ = ["recover_exposures"]
