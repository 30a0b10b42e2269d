"""Recordings: frames one by one, each with its exposure and time stamp.

:func:`open_recording` recognises the kind of recording from its content; :mod:`ospc.recording.kinds` says how to add
a kind.
"""

from ospc.recording.frame import Frame
from ospc.recording.kinds import cameras_of, open_recording
from ospc.recording.recording import ArrayRecording, Recording, identity

__all__ = ["ArrayRecording", "Frame", "Recording", "cameras_of", "identity", "open_recording"]
