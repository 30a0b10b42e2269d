"""Calibrate a running camera in a background thread, with advice on what to film next."""

from __future__ import annotations

from ospc.live.advice import Instruction
from ospc.live.calibrator import LiveCalibrator
from ospc.live.status import LiveStatus

__all__ = ["Instruction", "LiveCalibrator", "LiveStatus"]
