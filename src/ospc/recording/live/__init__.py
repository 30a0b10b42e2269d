"""Live cameras: frames with exposures from camera drivers.

:func:`open_camera` opens a camera given by a short text such as ``opencv:0`` or ``realsense``.
"""

from ospc.recording.live.drivers import names_camera, open_camera
from ospc.recording.live.source import Camera

__all__ = ["Camera", "names_camera", "open_camera"]
