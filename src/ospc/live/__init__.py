"""Cameras that do not wait: calibrating in the background, and watching over what was found."""

from __future__ import annotations

from ospc.live.calibrator import LiveCalibrator, LiveStatus
from ospc.live.watch import Watch

__all__ = ["LiveCalibrator", "LiveStatus", "Watch"]
