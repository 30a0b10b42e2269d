"""Cameras while they film: frames with their exposures, one after the other, as drivers give them.

:func:`open_camera` opens one by a short text such as ``opencv:0`` or ``realsense``.
"""

from ospc.recording.live.cameras import open_camera
from ospc.recording.live.source import Camera

__all__ = ["Camera", "open_camera"]
