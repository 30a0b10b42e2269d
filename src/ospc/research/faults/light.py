"""Faults of light, optics and scene, which change the irradiance on the sensor."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np

from ospc.arrays import Float32Array, FloatArray
from ospc.photometry.geometry import half_diagonal, pixel_grid
from ospc.photometry.vignette import RasterVignette
from ospc.research.faults.footage import Fault, Footage

_LAMP_HZ = 100.0
"""Flicker frequency of lamps on 50 Hz mains."""
_MS_PER_S = 1000.0

_SHUTTER_SPEEDS = np.array([
    1, 1.3, 1.5, 1.6, 2, 2.5, 3, 4, 5, 6, 8, 10, 13, 15, 20, 25, 30, 40, 45, 50, 60, 80, 90, 100, 125, 160, 180, 200,
    250, 320, 350, 400, 500, 640, 750, 800, 1000, 1250, 1500, 1600, 2000, 2500, 3000, 3200, 4000, 5000, 6400, 8000,
])  # fmt: skip
"""Nominal shutter speeds in steps of thirds and halves of a stop, such as 60 for 1/60 s."""
_READOUT_CYCLES = 1.5
"""Flicker cycles while a rolling shutter reads all rows."""


def _factored(footage: Footage, factor: FloatArray) -> Footage:
    """Multiply the light of every frame by a factor, shape (frames,)."""
    return footage.relit(lambda light, i: light * np.float32(factor[i]))


def _dimmed(footage: Footage, power: float) -> Footage:
    exposures_ms = footage.camera.exposures_ms
    return replace(_factored(footage, (exposures_ms / np.median(exposures_ms)) ** -power), power=1 / (1 - power))


def _locked_flicker(footage: Footage, share: float) -> Footage:
    exposures_ms = footage.camera.exposures_ms
    # Every exposure is centred on a maximum of the light.
    factor = 1 + share * np.sinc(_LAMP_HZ * exposures_ms / 1000)
    # The light is nearly a power of the exposure, which the images cannot show.
    power = np.polyfit(np.log(exposures_ms * factor), np.log(exposures_ms), 1)[0]
    return replace(_factored(footage, factor), power=float(power))


def _times(footage: Footage, factor: Float32Array) -> Footage:
    """Multiply the light of every pixel by a factor, shape (height, width)."""
    return footage.relit(lambda light, _i: light * factor)


def _scattered(footage: Footage, share: float, *sigmas_widths: float) -> Footage:
    """Scatter a share of the light, in equal parts over several standard deviations of distance, in image widths."""

    def spread(light: Float32Array, _i: int) -> Float32Array:
        small = cv2.resize(light, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
        sigmas_px = [widths * small.shape[1] for widths in sigmas_widths]
        parts = [cv2.GaussianBlur(small, (0, 0), px, borderType=cv2.BORDER_CONSTANT) for px in sigmas_px]
        around = np.mean(parts, axis=0, dtype=np.float32)
        return np.asarray((1 - share) * light + share * cv2.resize(around, light.shape[::-1]))

    return footage.relit(spread)


def _stray_light(footage: Footage, share: float) -> Footage:
    squared_radius = np.sum(footage.from_centre() ** 2, axis=-1)
    return _fixed_light(footage, share * squared_radius / squared_radius.max())


def _fixed_light(footage: Footage, light: float | FloatArray) -> Footage:
    """Add light that does not come from the scene, given at the median exposure, shape () or (height, width)."""
    relative = footage.camera.exposures_ms / np.median(footage.camera.exposures_ms)
    return footage.relit(lambda scene, i: scene + np.asarray(light * relative[i], np.float32))


def _row_flicker(footage: Footage, amplitude: float) -> Footage:
    rows = np.linspace(0, _READOUT_CYCLES, footage.images[0].shape[0])[:, None]
    return footage.relit(lambda light, i: light * (1 + amplitude * np.sin(2 * np.pi * (rows + 0.37 * i))))


def _clouds(footage: Footage, amplitude: float) -> Footage:
    phase = footage.random.uniform(0, 2 * np.pi, 3)
    time = np.arange(len(footage)) / len(footage)
    course = sum(np.sin(2 * np.pi * cycles * time + p) for cycles, p in zip((1.3, 3.1, 7.7), phase, strict=True))
    return _factored(footage, np.exp(amplitude * np.asarray(course) / 2))


def _shaded(footage: Footage, transmission: Float32Array) -> Footage:
    """Attenuate the light by a transmission that becomes part of the vignette."""
    known = None if footage.vignette is None else RasterVignette(footage.camera.attenuation * transmission)
    return replace(_times(footage, transmission), vignette=known)


def _smudge(footage: Footage, depth: float) -> Footage:
    x, y = np.moveaxis(footage.from_centre() / len(footage.images[0]), -1, 0)
    transmission = np.ones_like(x)
    for centre in footage.random.uniform(-0.5, 0.5, (4, 2)):
        transmission -= depth * np.exp(-((x - centre[0]) ** 2 + (y - centre[1]) ** 2) / (2 * 0.04**2))
    return _shaded(footage, np.clip(transmission, 0.05, 1).astype(np.float32))


def _hooded(footage: Footage, depth: float) -> Footage:
    """Darken the corners as a rectangular hood does."""
    height, width = footage.images[0].shape
    x, y = np.moveaxis(footage.from_centre() / half_diagonal((width, height)), -1, 0)
    return _shaded(footage, (1 - depth * (x**4 + y**4)).astype(np.float32))


def _decentred(footage: Footage, shift: float) -> Footage:
    """Move the vignette to the right and half as far down, if it is known."""
    if footage.vignette is None:
        return footage
    height, width = footage.images[0].shape
    moved = footage.vignette.at(pixel_grid((width, height)) - [shift * height, shift * height / 2])
    return _shaded(footage, np.asarray(moved / footage.camera.attenuation, np.float32))


def _leaf_shutter(footage: Footage, rise: float) -> Footage:
    """Brighten the corners in proportion to ln exposure: the blades of a leaf shutter uncover the centre first."""
    height, width = footage.images[0].shape
    squared_radius = np.sum((footage.from_centre() / half_diagonal((width, height))) ** 2, axis=-1)
    exposures_ms = footage.camera.exposures_ms
    log_exposure = np.log(exposures_ms / np.median(exposures_ms))
    return footage.relit(lambda light, i: light * np.exp(rise * log_exposure[i] * squared_radius).astype(np.float32))


def _shot_noise(footage: Footage, sigma: float) -> Footage:
    def noisy(light: Float32Array, _i: int) -> Float32Array:
        drawn = footage.random.standard_normal(light.shape, dtype=np.float32)
        return np.asarray(light + np.float32(sigma) * np.sqrt(np.maximum(light, 0)) * drawn)

    return footage.relit(noisy)


def _speculars(footage: Footage, share: float) -> Footage:
    def glinting(light: Float32Array, _i: int) -> Float32Array:
        spots = (footage.random.random(light.shape) < share / 9).astype(np.uint8)
        return np.where(cv2.dilate(spots, np.ones((3, 3), np.uint8)) > 0, light * 10, light)

    return footage.relit(glinting)


def _crowd(footage: Footage, count: float) -> Footage:
    """Move patches of various brightness, an eighth of the height wide, in front of the scene."""
    height, width = footage.images[0].shape
    side, number = height // 8, int(count)
    start, speed = footage.random.uniform(0, 1, (number, 2)), footage.random.uniform(-0.02, 0.02, (number, 2))
    level = np.exp(footage.random.uniform(-2, 2, number))
    typical = float(np.median(footage.camera.radiance(0)))

    def crossed(light: Float32Array, i: int) -> Float32Array:
        result = light.copy()
        for n in range(number):
            x, y = ((start[n] + i * speed[n]) % 1 * (width, height)).astype(int)
            place = (slice(y, y + side), slice(x, x + side))
            exposure = np.float32(footage.camera.exposures_ms[i] * typical * level[n])
            result[place] = footage.camera.attenuation[place] * exposure
        return result

    return footage.relit(crossed)


def _motion_blur(footage: Footage, frames: float) -> Footage:
    camera, span = footage.camera, int(frames) // 2

    def averaged(_light: Float32Array, i: int) -> Float32Array:
        around = range(max(0, i - span), min(len(footage), i + span + 1))
        mean = np.mean([camera.radiance(j) for j in around], axis=0)
        return np.asarray(mean * camera.attenuation * camera.exposures_ms[i])

    return footage.relit(averaged)


def _small_range(footage: Footage, ratio: float) -> Footage:
    logs = np.log(footage.camera.exposures_ms)
    span = max(float(np.ptp(logs)), 1e-9)
    return _reshot(footage, np.exp(np.median(logs) + (logs - np.median(logs)) * np.log(ratio) / span))


def _roll_only(footage: Footage, degrees: float) -> Footage:
    """Roll the camera about its optical axis by up to this angle either way, over a single view."""
    first = footage.camera.radiance(0)
    height, width = first.shape
    angle = degrees * footage.wave(6)

    def turned(_image: Float32Array, i: int) -> Float32Array:
        turn = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), float(angle[i]), 1.0)
        return np.asarray(cv2.warpAffine(first, turn, (width, height), borderMode=cv2.BORDER_REFLECT))

    return _reshot(footage, footage.camera.exposures_ms, turned)


def _reshot(
    footage: Footage,
    exposures_ms: FloatArray,
    change: Callable[[Float32Array, int], Float32Array] = lambda scene, _i: scene,
) -> Footage:
    """Film a scene, which may change, at given exposures, which are recorded in the metadata."""
    camera = footage.camera
    return footage.relit(
        lambda _light, i: change(camera.radiance(i), i) * camera.attenuation * np.float32(exposures_ms[i])
    ).with_exposures(exposures_ms)


def _in_steps(footage: Footage, steps_per_stop: float) -> tuple[Footage, FloatArray]:
    """Expose in exact steps of 2^(1/n); return the recording, and its exposures in seconds."""
    exposures_s = footage.exposures_ms / _MS_PER_S
    exact_s = 2 ** (np.rint(np.log2(exposures_s) * steps_per_stop) / steps_per_stop)
    return _factored(footage, exact_s / exposures_s), exact_s


def _nominal_exposures(footage: Footage, steps_per_stop: float) -> Footage:
    """Expose in exact steps of 2^(1/n), and state the nominal shutter speeds."""
    taken, exact_s = _in_steps(footage, steps_per_stop)
    stated = np.argmin(np.abs(np.log(exact_s[:, None]) + np.log(_SHUTTER_SPEEDS)), axis=1)
    return taken.with_exposures(_MS_PER_S / _SHUTTER_SPEEDS[stated])


def _inexact_steps(footage: Footage, error: float) -> Footage:
    """Expose in steps of half a stop, and state each exposure with its own error."""
    taken, exact_s = _in_steps(footage, 2)
    different_s, place = np.unique(exact_s, return_inverse=True)
    stated_s = different_s * np.exp(error * footage.random.standard_normal(len(different_s)))
    return taken.with_exposures(_MS_PER_S * stated_s[place])


FAULTS = (
    Fault("glare", "veiling glare of {} of the frame's mean irradiance", (0.01, 0.02, 0.05),
        lambda f, x: f.relit(lambda light, _i: light + np.float32(x) * light.mean())),
    Fault("near-glare", "{} of the irradiance scattered nearby", (0.02, 0.05, 0.1),
        lambda f, x: _scattered(f, x, 0.1)),
    # The same share in each doubling of the distance.
    Fault("wide-glare", "{} of the irradiance scattered with the inverse square of the distance", (0.02, 0.05, 0.1),
        lambda f, x: _scattered(f, x, *0.5 ** np.arange(1, 7))),
    Fault("bloom", "{} of the light beyond saturation spills over", (0.1, 0.3, 1),
        lambda f, x: f.relit(lambda light, _i: light + x * cv2.GaussianBlur(np.maximum(light - 1, 0), (0, 0), 8))),
    Fault("dark-current", "dark current of {} of saturation at the median exposure", (0.005, 0.01, 0.02),
        _fixed_light),
    Fault("stray-light", "light fixed to the camera, at the corners {} of saturation at the median exposure",
        (0.003, 0.01, 0.03), _stray_light),
    Fault("persistence", "{} of the frame before remains", (0.02, 0.05, 0.1),
        lambda f, x: f.relit(
            lambda light, i: light + np.float32(x) * np.minimum(f.camera.irradiance[max(0, i - 1)], 1)
        )),
    Fault("locked-flicker", "100 Hz flicker of ±{} synchronous with the frames", (0.1, 0.3, 0.6), _locked_flicker),
    Fault("beating-flicker", "flicker of ±{} every 8.7 frames", (0.02, 0.05, 0.15),
        lambda f, x: _factored(f, 1 + x * f.wave(len(f) / 8.7))),
    Fault("row-flicker", "flicker of ±{} along the rows of a rolling shutter", (0.02, 0.05, 0.15), _row_flicker),
    Fault("lamp", "light that switches by a factor of {}", (1.1, 1.3, 2),
        lambda f, x: _factored(f, x ** (f.blocks(50) / 2))),
    Fault("clouds", "light that varies by ±{} in ln", (0.05, 0.15, 0.4), _clouds),
    Fault("white-balance", "a gain that drifts by ±{}", (0.05, 0.1, 0.25),
        lambda f, x: _factored(f, 1 + x * f.wave(2.5))),
    Fault("nominal-exposures", "nominal shutter speeds in steps of a stop over {}", (3, 2, 1), _nominal_exposures),
    Fault("inexact-steps", "exposures in half stops, each stated with a random error of {}", (0.005, 0.01, 0.03),
        _inexact_steps),
    Fault("dimming", "light proportional to the exposure to the power of -{}", (0.05, 0.1, 0.2), _dimmed),
    Fault("shading-corrected", "V to the power of {} divided out by the camera", (0.25, 0.5, 1),
        lambda f, x: _shaded(f, f.camera.attenuation ** np.float32(-x))),
    Fault("smudge", "four smudges that take {} of the light", (0.1, 0.3, 0.6), _smudge),
    Fault("graduated-filter", "a filter that takes {} of the light at the top", (0.1, 0.25, 0.5),
        lambda f, x: _shaded(
            f, (1 - x * (0.5 - f.from_centre()[..., 1] / len(f.images[0]))).astype(np.float32)
        )),
    Fault("square-vignette", "a hood that takes {} (x⁴ + y⁴) of the light", (0.05, 0.1, 0.2), _hooded),
    Fault("decentred", "a vignette shifted by {} of the height", (0.03, 0.06, 0.12), _decentred),
    Fault("vignette-midway", "V to the power of {} in the second half", (0.8, 0.5, 0),
        lambda f, x: f.relit(
            lambda light, i: light * f.camera.attenuation ** np.float32(x - 1) if i >= f.half else light
        )),
    Fault("leaf-shutter", "ln V at the corners rising by {} per factor e of the exposure", (0.01, 0.03, 0.1),
        _leaf_shutter),
    Fault("pixel-gains", "pixel gains that scatter by {}", (0.01, 0.02, 0.05),
        lambda f, x: _times(f, np.exp(x * f.random.standard_normal(f.images[0].shape)).astype(np.float32))),
    Fault("shot-noise", "shot noise of {} at saturation", (0.02, 0.04, 0.08), _shot_noise),
    Fault("overexposed", "{} times the light", (1.5, 2, 4), lambda f, x: _factored(f, np.full(len(f), x))),
    Fault("underexposed", "{} times less light", (2, 4, 16), lambda f, x: _factored(f, np.full(len(f), 1 / x))),
    Fault("speculars", "glints over a fraction of {} of the image", (0.001, 0.005, 0.02), _speculars),
    Fault("crowd", "{} patches moving in front of the scene", (4, 12, 40), _crowd),
    Fault("motion-blur", "motion blur over {} frames", (3, 5, 9), _motion_blur),
    Fault("textureless", "a scene smoothed over {} of the width", (0.02, 0.05, 0.15),
        lambda f, x: _reshot(
            f, f.camera.exposures_ms, lambda image, _i: cv2.GaussianBlur(image, (0, 0), x * image.shape[1])
        )),
    Fault("constant-exposure", "the exposure fixed at {} times the median", (1, 0.5, 2),
        lambda f, x: _reshot(f, np.full(len(f), x * np.median(f.camera.exposures_ms)))),
    Fault("small-range", "exposures within a factor of {}", (1.5, 1.2, 1.1), _small_range),
    Fault("standing-still", "the camera at rest for a fraction of {}", (0.3, 0.7, 1),
        # It keeps the view of the first frame.
        lambda f, x: _reshot(
            f, f.camera.exposures_ms,
            lambda image, i: f.camera.radiance(0) if i < round(x * len(f)) else image,
        )),
    Fault("roll-only", "the camera only rolls by ±{} degrees about its axis", (10, 40, 90), _roll_only),
)  # fmt: skip
