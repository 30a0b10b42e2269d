"""Recordings: sequences of frames with exposures and time stamps.

:func:`open_recording` recognises the kind of a recording from its content; :mod:`ospc.recording.kinds` describes how
to add a kind.
"""

from ospc.recording.frame import Frame
from ospc.recording.kinds import cameras_of, open_recording
from ospc.recording.recording import ArrayRecording, Recording, identity

__all__ = ["ArrayRecording", "Frame", "Recording", "cameras_of", "identity", "open_recording"]
