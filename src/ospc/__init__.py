"""Online sequential photometric calibration of cameras from ordinary recordings.

This is the public interface. Names are loaded on first use, so importing the package is fast.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ospc.calibrator import OnlineCalibrator as OnlineCalibrator
    from ospc.calibrator import calibrate as calibrate
    from ospc.errors import OspcError as OspcError
    from ospc.live import LiveCalibrator as LiveCalibrator
    from ospc.methods.fitting import calibrate_observations as calibrate_observations
    from ospc.methods.fitting import fit as fit
    from ospc.observations import Observations as Observations
    from ospc.photometry.calibration import Calibration as Calibration
    from ospc.photometry.response import Response as Response
    from ospc.photometry.vignette import Vignette as Vignette
    from ospc.recording import Frame as Frame
    from ospc.recording import Recording as Recording
    from ospc.recording import open_recording as open_recording
    from ospc.simulation import simulate as simulate

__version__ = "0.1.0"

_HOME = {
    "ospc.calibrator": ("OnlineCalibrator", "calibrate"),
    "ospc.errors": ("OspcError",),
    "ospc.methods.fitting": ("calibrate_observations", "fit"),
    "ospc.live": ("LiveCalibrator",),
    "ospc.observations": ("Observations",),
    "ospc.photometry.calibration": ("Calibration",),
    "ospc.photometry.response": ("Response",),
    "ospc.photometry.vignette": ("Vignette",),
    "ospc.recording": ("Frame", "Recording", "open_recording"),
    "ospc.simulation": ("simulate",),
}
_MODULES = {name: module for module, names in _HOME.items() for name in names}

__all__ = [
    "Calibration",
    "Frame",
    "LiveCalibrator",
    "Observations",
    "OnlineCalibrator",
    "OspcError",
    "Recording",
    "Response",
    "Vignette",
    "__version__",
    "calibrate",
    "calibrate_observations",
    "fit",
    "open_recording",
    "simulate",
]
"""Spelled out because type checkers do not run the package."""


def __getattr__(name: str) -> Any:
    """Load a public name on first use."""
    if name not in _MODULES:
        raise AttributeError(f"module 'ospc' has no attribute {name!r}")
    value = getattr(import_module(_MODULES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """List the public names."""
    return sorted(__all__)
