"""Check recordings: what a recording can determine about its camera, and what is wrong with it."""

from ospc.diagnosis.check import check_recording
from ospc.diagnosis.report import RecordingReport

__all__ = ["RecordingReport", "check_recording"]
