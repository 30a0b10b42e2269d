"""Live cameras: frames with their exposures as drivers deliver them.

:func:`open_camera` opens a camera by a short text such as ``opencv:0`` or ``realsense``.
"""

from ospc.recording.live.drivers import open_camera
from ospc.recording.live.source import Camera

__all__ = ["Camera", "open_camera"]
