"""The truth of a simulated recording, computed without rendering full images."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ospc.arrays import FloatArray
from ospc.photometry.response import Response
from ospc.photometry.vignette import Vignette
from ospc.simulation.motion import Motion
from ospc.simulation.rendering import View, radiance
from ospc.simulation.responses import make_response, make_vignette
from ospc.simulation.scene import Scene
from ospc.simulation.settings import SimulationSettings

_METER_SIZE = 64
"""Width in pixels of the small image that auto exposure meters."""
_SETTLING_STEPS = 40
"""Steps of auto exposure before the first frame: at the default rate, enough for a change by a factor of 100."""
_DARKEST_METERED = 1e-3
"""Lower bound of the metered mean grey level, which limits the step on a black image."""

_WRITTEN_BY_FRAME = ("stamps_s", "times_ms", "gains", "exposures_ms", "metadata_exposures_ms", "light")


@dataclass(frozen=True)
class Truth:
    """The truth of a simulated recording."""

    settings: SimulationSettings
    response: Response
    vignette: Vignette
    stamps_s: FloatArray
    """Time stamps in seconds, at the middle of the exposures, shape (frames,)."""
    times_ms: FloatArray
    """True exposure times, shape (frames,)."""
    gains: FloatArray
    """True linear gains, shape (frames,)."""
    exposures_ms: FloatArray
    """True exposures, time times gain, shape (frames,)."""
    metadata_exposures_ms: FloatArray
    """Exposures in the metadata, shape (frames,)."""
    light: FloatArray
    """Brightness factor due to flicker, averaged over each exposure, shape (frames,)."""
    trajectory: FloatArray
    """Rows (tx, ty, tz, qx, qy, qz, qw), camera to world, metres, shape (frames, 7)."""

    def as_dict(self) -> dict[str, Any]:
        """Return the content of ``truth.json`` as JSON-compatible values."""
        return {
            "schema": "ospc-truth/1",
            "settings": self.settings.as_dict(),
            "response": {"model": self.response.model, "inverse_256": self.response.resampled(256).tolist()},
            "vignette": self.vignette.as_dict(),
            "max_grey": self.settings.max_grey,
            "focal_px": self.settings.focal_px,
            **{name: getattr(self, name).tolist() for name in _WRITTEN_BY_FRAME},
        }


def truth(settings: SimulationSettings = SimulationSettings()) -> Truth:  # noqa: B008 - a frozen value
    """Return the truth of a simulated recording without rendering its images.

    Raises
    ------
    SettingError
        If the response or vignette does not exist.
    FormatError
        If a response or vignette file cannot be read.
    """
    response, vignette = make_response(settings.response), make_vignette(settings)
    stamps = np.arange(settings.frames) / settings.fps
    if settings.exposure == "auto":
        times, gains = _auto_exposure(settings, response, vignette, stamps)
    else:
        times, gains = _programmed(settings), np.full(settings.frames, settings.gain)
    from scipy.spatial.transform import Rotation  # slow to import

    positions, rotations = Motion.of(settings).at(stamps)
    return Truth(
        settings,
        response,
        vignette,
        stamps,
        times,
        gains,
        times * gains,
        _metadata(settings, times * gains),
        flicker(settings, stamps, times),
        np.hstack([positions, Rotation.from_matrix(rotations).as_quat()]),
    )


def flicker(settings: SimulationSettings, stamps_s: FloatArray, times_ms: FloatArray) -> FloatArray:
    """Return the mean of 1 + a·sin(2πft) over exposures centred at the stamps, shape (frames,)."""
    share = np.sinc(settings.flicker_hz * times_ms / 1000)
    return np.asarray(1 + settings.flicker * share * np.sin(2 * np.pi * settings.flicker_hz * stamps_s))


def view_at(settings: SimulationSettings, motion: Motion, time_s: float, width: int | None = None) -> View:
    """Return the camera at an instant, with images scaled to ``width`` if given."""
    positions, rotations = motion.at(time_s)
    scale = 1.0 if width is None else width / settings.size[0]
    size = settings.size if width is None else (width, max(1, round(settings.size[1] * scale)))
    return View(size, settings.focal_px * scale, positions[0], rotations[0])


def _programmed(settings: SimulationSettings) -> FloatArray:
    if settings.exposure == "sweep":
        return np.geomspace(settings.exposure_min_ms, settings.exposure_max_ms, settings.frames)
    listed = (settings.exposure_ms,) if settings.exposure == "constant" else settings.exposures_ms
    return np.resize(np.array(listed, dtype=np.float64), settings.frames)


def _metadata(settings: SimulationSettings, exposures_ms: FloatArray) -> FloatArray:
    """Return the exposures in the metadata, with lag and errors."""
    index = np.clip(np.arange(settings.frames) - settings.lag, 0, settings.frames - 1)
    error = np.random.default_rng([settings.seed, 4]).standard_normal(settings.frames)
    return np.asarray(exposures_ms[index] * np.exp(settings.metadata_error * error))


def _auto_exposure(
    settings: SimulationSettings, response: Response, vignette: Vignette, stamps_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the exposure times and gains of auto exposure, a control loop that meters the previous frame."""
    # It raises the gain only after the exposure time has reached its limit.
    scene, motion = Scene.of(settings), Motion.of(settings)
    width = min(_METER_SIZE, settings.size[0])
    low = float(np.log(settings.exposure_min_ms * settings.gain))
    high = float(np.log(settings.exposure_max_ms * settings.gain_max))
    attenuation = _thumbnail(vignette, view_at(settings, motion, 0.0, width).size)

    def meter(stamp_s: float) -> FloatArray:
        return radiance(scene, view_at(settings, motion, stamp_s, width), stamp_s) * attenuation

    def controlled(log_e: float, light: FloatArray) -> float:
        """Take a limited step proportional to the deviation of the mean grey level."""
        grey = max(float(np.mean(response(light * np.exp(log_e)))), _DARKEST_METERED)
        wanted = settings.auto_gain * np.log(settings.auto_target / grey)
        return min(max(log_e + float(np.clip(wanted, -settings.auto_rate, settings.auto_rate)), low), high)

    log_e = float(np.clip(np.log(settings.reference_exposure_ms * settings.gain), low, high))
    metered = meter(float(stamps_s[0]))
    for _ in range(_SETTLING_STEPS):
        log_e = controlled(log_e, metered)
    result = np.empty(settings.frames)
    for i, stamp in enumerate(stamps_s):
        result[i] = log_e
        if i > 0 and not settings.stationary:
            metered = meter(float(stamp))
        time_ms = min(np.exp(log_e) / settings.gain, settings.exposure_max_ms)
        log_e = controlled(log_e, metered * float(flicker(settings, stamp, np.asarray(time_ms))))
    exposures = np.exp(result)
    times = np.minimum(exposures / settings.gain, settings.exposure_max_ms)
    return times, exposures / times


def _thumbnail(vignette: Vignette, size: tuple[int, int]) -> FloatArray:
    """Return a vignette at the resolution of the metered image, shape (height, width)."""
    x = (np.arange(size[0]) + 0.5) / size[0] * vignette.size[0] - 0.5
    y = (np.arange(size[1]) + 0.5) / size[1] * vignette.size[1] - 0.5
    return vignette.at(np.stack(np.broadcast_arrays(x[None, :], y[:, None]), axis=-1))
