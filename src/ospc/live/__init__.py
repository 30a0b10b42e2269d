"""Cameras that do not wait: the engine beside a camera, in a thread of its own, with advice on what to film next."""

from __future__ import annotations

from ospc.live.advice import Instruction
from ospc.live.calibrator import LiveCalibrator
from ospc.live.status import LiveStatus

__all__ = ["Instruction", "LiveCalibrator", "LiveStatus"]
