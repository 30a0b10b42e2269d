"""The settings of a simulation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Literal, get_args

from ospc.arrays import ImageSize
from ospc.errors import SettingError
from ospc.photometry.response import Response
from ospc.photometry.vignette import Vignette

ExposureMode = Literal["auto", "sweep", "cycle", "file", "constant"]
MotionKind = Literal["handheld", "static", "pan", "forward"]
NoisePreset = Literal["none", "low", "high"]
ImageFormat = Literal["png", "jpg"]

NOISE_PRESETS: dict[str, tuple[float, float]] = {
    "none": (math.inf, 0.0),
    "low": (20_000.0, 5.0),
    "high": (3_000.0, 12.0),
}
"""Full well and read noise in electrons. Low: a machine-vision sensor in good light; high: a small sensor in poor
light."""
_CHOICES = {
    "exposure": get_args(ExposureMode),
    "motion": get_args(MotionKind),
    "noise": get_args(NoisePreset),
    "image_format": get_args(ImageFormat),
}
_ABOVE_0 = (
    "fps", "speed", "horizontal_fov_deg", "reference_exposure_ms", "exposure_ms", "exposure_min_ms",
    "exposure_max_ms", "auto_target", "auto_rate", "auto_gain", "gain", "gain_max", "flicker_hz",
)  # fmt: skip
_AT_LEAST_0 = ("metadata_error", "flicker")
_WHOLE = {
    "frames": (1, 1_000_000),
    "bit_depth": (8, 16),
    "jpg_quality": (1, 100),
    "motion_blur_samples": (1, 64),
    "moving_objects": (0, 16),
}
"""Limits of integer settings; 16 patches fit between the camera and the boxes."""
_SIDE_PX = (16, 8192)
"""Limits of width and height in pixels: large enough for the pyramid of the exposure meter, and at most 256 MB for a
float image."""
_MAX_FOV_DEG = 140
"""Upper limit of the field of view in degrees; a wider pinhole camera wastes most pixels on the corners."""


@dataclass(frozen=True)
class SimulationSettings:
    """Settings of a simulated recording. The same settings give the same recording, bit for bit.

    Attributes
    ----------
    size
        Width and height of the images in pixels.
    frames
        Number of images.
    fps
        Images per second.
    seed
        Seed of the scene, motion, noise and metadata errors.
    scene_seed
        Seed of the scene if it differs from ``seed``, to film one scene in several ways.
    bit_depth
        Bits per grey value, 8 to 16; above 8, images are stored as right-aligned 16-bit words.
    response
        Name from :data:`ospc.simulation.responses.RESPONSES`, a pcalib.txt, or a response.
    vignette
        Name from :data:`ospc.simulation.responses.VIGNETTES`, a vignette.png, or a vignette.
    vignette_coefficients
        (v₁, v₂, v₃) of the vignettes ``"polynomial"`` and ``"decentred"``, with radius 1 at the corner.
    noise
        Preset for the following two sensor settings.
    full_well_electrons
        Electrons at the largest grey value at gain 1, inf for no shot noise; None for the value of the preset.
    read_noise_electrons
        Standard deviation of the read noise in electrons; None for the value of the preset.
    motion
        ``"handheld"`` walks and looks around, ``"pan"`` turns on the spot, ``"forward"`` moves along the optical
        axis, ``"static"`` stands on a tripod.
    speed
        Factor on the speed of the motion.
    horizontal_fov_deg
        Horizontal field of view in degrees.
    motion_blur_samples
        Number of instants of the exposure that are averaged; 1 for no motion blur.
    exposure
        ``"auto"``: auto exposure. ``"sweep"``: logarithmic, from the smallest to the largest. ``"cycle"``: through
        ``exposures_ms``. ``"file"``: ``exposures_ms`` frame by frame. ``"constant"``: ``exposure_ms``.
    exposure_ms
        Exposure time of ``"constant"``.
    exposures_ms
        Exposure times of ``"cycle"`` and ``"file"``.
    exposure_min_ms, exposure_max_ms
        Limits of ``"auto"`` and ``"sweep"``.
    reference_exposure_ms
        Exposure at which the irradiance of the median scene surface is 0.12 of saturation.
    auto_target
        Target of auto exposure: mean grey level in [0, 1].
    auto_gain
        Change of ln exposure per logarithmic deviation of the mean grey level in one step of auto exposure.
    auto_rate
        Largest change of ln exposure between consecutive frames.
    gain
        Linear gain of every frame.
    gain_max
        Largest linear gain that auto exposure may use once the exposure time is at its maximum.
    lag
        The metadata of frame i contain the exposure of frame i − lag; positive if they are late.
    metadata_error
        Standard deviation of a multiplicative (log-normal) error of the metadata.
    flicker
        Relative amplitude of the oscillation of the light, below 1.
    flicker_hz
        Frequency of the oscillation in Hz.
    moving_objects
        Number of textured patches, up to 16, that move in front of the scene.
    image_format
        ``"png"`` or ``"jpg"`` (8 bit only).
    jpg_quality
        JPEG quality, 1 to 100.
    archive
        Whether to store the images in ``images.zip`` instead of the folder ``images``.
    """

    size: ImageSize = (640, 480)
    frames: int = 500
    fps: float = 20.0
    seed: int = 0
    scene_seed: int | None = None
    bit_depth: int = 8

    response: str | Path | Response = "gamma2.2"
    vignette: str | Path | Vignette = "polynomial"
    vignette_coefficients: tuple[float, ...] = (-0.35, 0.05, -0.15)
    noise: NoisePreset = "low"
    full_well_electrons: float | None = None
    read_noise_electrons: float | None = None

    motion: MotionKind = "handheld"
    speed: float = 1.0
    horizontal_fov_deg: float = 75.0
    motion_blur_samples: int = 1

    exposure: ExposureMode = "auto"
    exposure_ms: float = 10.0
    exposures_ms: tuple[float, ...] = (2.5, 5.0, 10.0, 20.0)
    exposure_min_ms: float = 0.3
    exposure_max_ms: float = 40.0
    reference_exposure_ms: float = 10.0
    auto_target: float = 0.42
    auto_gain: float = 0.6
    auto_rate: float = 0.12
    gain: float = 1.0
    gain_max: float = 1.0

    lag: int = 0
    metadata_error: float = 0.0
    flicker: float = 0.0
    flicker_hz: float = 2.3
    moving_objects: int = 0

    image_format: ImageFormat = "png"
    jpg_quality: int = 95
    archive: bool = False

    def __post_init__(self) -> None:
        for name, allowed in _CHOICES.items():
            self._require(name, getattr(self, name) in allowed, f"choose one of {', '.join(allowed)}")
        for name in _ABOVE_0:
            self._require(name, _positive(getattr(self, name)), "give a finite number above 0")
        for name in _AT_LEAST_0:
            self._require(name, _not_negative(getattr(self, name)), "give a finite number of at least 0")
        for name, (low, high) in _WHOLE.items():
            value = getattr(self, name)
            fine = isinstance(value, int) and low <= value <= high
            self._require(name, fine, f"give a whole number from {low} to {high}")
        for name, seed in (("seed", self.seed), ("scene_seed", self.scene_seed or 0)):
            self._require(name, isinstance(seed, int) and seed >= 0, "give a whole number of at least 0")
        self._check_camera()
        self._check_exposures()

    def _require(self, name: str, fine: bool, remedy: str) -> None:
        if not fine:
            raise SettingError(f"{name} is {getattr(self, name)!r}; {remedy}")

    def _check_camera(self) -> None:
        low, high = _SIDE_PX
        size = self.size if isinstance(self.size, Sequence) else ()
        fine = len(size) == 2 and all(isinstance(n, int) and low <= n <= high for n in size)
        self._require("size", fine, f"give width and height, {low} to {high} pixels each")
        if self.image_format == "jpg":
            self._require("bit_depth", self.bit_depth == 8, "JPEG stores 8 bits; set image_format to 'png'")
        wide = self.horizontal_fov_deg >= _MAX_FOV_DEG
        self._require("horizontal_fov_deg", not wide, f"give less than {_MAX_FOV_DEG} for a pinhole camera")
        full_well, read_noise = self.sensor
        self._require("full_well_electrons", full_well > 0, "give a number above 0, or inf for no shot noise")
        self._require("read_noise_electrons", _not_negative(read_noise), "give a finite number of at least 0")
        if math.isinf(full_well) and read_noise > 0:
            raise SettingError("read noise in electrons requires a finite full well; set full_well_electrons")

    def _check_exposures(self) -> None:
        in_order = self.exposure_min_ms <= self.exposure_max_ms
        self._require("exposure_min_ms", in_order, f"give at most exposure_max_ms, {self.exposure_max_ms}")
        if self.exposure in ("cycle", "file"):
            exposures_ms = self.exposures_ms if isinstance(self.exposures_ms, Sequence) else ()
            listed = bool(exposures_ms) and all(map(_positive, exposures_ms))
            self._require("exposures_ms", listed, "list finite exposure times above 0 in milliseconds")
        if self.exposure == "file" and len(self.exposures_ms) != self.frames:
            raise SettingError(
                f"exposures_ms has {len(self.exposures_ms)} exposures for {self.frames} frames; give one per frame"
            )
        if self.exposure == "auto":
            self._require("gain_max", self.gain_max >= self.gain, f"give at least gain, {self.gain}")
        self._require("auto_target", self.auto_target < 1, "give a grey level between 0 and 1")
        self._require("flicker", self.flicker < 1, "give a relative amplitude below 1")
        short = isinstance(self.lag, int) and abs(self.lag) < self.frames
        self._require("lag", short, f"give a whole number of frames, fewer than {self.frames}")

    @property
    def sensor(self) -> tuple[float, float]:
        """Full well and read noise in electrons."""
        full_well, read_noise = NOISE_PRESETS[self.noise]
        if self.full_well_electrons is not None:
            full_well = self.full_well_electrons
        if self.read_noise_electrons is not None:
            read_noise = self.read_noise_electrons
        return full_well, read_noise

    @property
    def stationary(self) -> bool:
        """Whether all frames show the same static view."""
        return self.motion == "static" and not self.moving_objects

    @property
    def max_grey(self) -> int:
        """Largest grey value."""
        return int(2**self.bit_depth - 1)

    @property
    def focal_px(self) -> float:
        """Focal length in pixels."""
        return self.size[0] / (2 * math.tan(math.radians(self.horizontal_fov_deg) / 2))

    def as_dict(self) -> dict[str, Any]:
        """Return all settings as JSON-compatible values."""
        values: dict[str, Any] = {f.name: getattr(self, f.name) for f in fields(self)}
        if isinstance(self.response, Response):
            values["response"] = self.response.model
        if not isinstance(self.vignette, str | Path):
            values["vignette"] = self.vignette.as_dict()
        full_well, values["read_noise_electrons"] = self.sensor
        values["full_well_electrons"] = None if math.isinf(full_well) else full_well
        return {
            k: str(v) if isinstance(v, Path) else list(v) if isinstance(v, tuple) else v for k, v in values.items()
        }


def _not_negative(value: object) -> bool:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return is_number and math.isfinite(value) and value >= 0  # type: ignore[arg-type, operator]


def _positive(value: object) -> bool:
    return _not_negative(value) and value != 0
