"""Cameras that do not wait: the engine beside a camera, in a thread of its own."""

from __future__ import annotations

from ospc.live.calibrator import LiveCalibrator, LiveStatus

__all__ = ["LiveCalibrator", "LiveStatus"]
