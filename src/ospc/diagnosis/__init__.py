"""What a recording can and cannot tell."""

from ospc.diagnosis.check import check_recording
from ospc.diagnosis.report import RecordingReport

__all__ = ["RecordingReport", "check_recording"]
