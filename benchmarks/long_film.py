"""Hours of film in which any frame can be rendered on its own, in about two milliseconds.

A camera looks around in front of large pictures, and moves on to another one every few minutes. Lamps are switched,
clouds pass, objects move through the view, and auto exposure follows with a camera's delay. Everything but the
exposure is a function of time, and the exposure follows from a coarse grid of the scene's brightness, so most frames
need not be rendered. The camera itself (response, vignette and noise) changes only by a :class:`Switch`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, partial
from itertools import chain

import cv2
import numpy as np

from ospc import Frame, Response, Vignette
from ospc.arrays import Float32Array, FloatArray, Image
from ospc.photometry.vignette import PolynomialVignette
from ospc.simulation import SimulationSettings
from ospc.simulation.camera import Sensor
from ospc.simulation.responses import make_response
from ospc.simulation.texture import TEXEL_M, painted, single

SIZE = (320, 240)
_PICTURE_M = (8.0, 8.0)
"""Size of a picture; with a texel of 4 mm it has 2000 x 2000 pixels."""

_PICTURES, _PANELS = 4, 220
"""Number of pictures, and of panels and posters on each."""

_PANEL_M, _PANEL_LEVELS = (0.2, 1.3), (0.04, 0.9)
"""Smallest and largest edge of a panel, and reflectance of the darkest and the brightest panel."""

_POSTERS = ("chelsea", "coffee", "camera", "gravel", "grass", "brick")

_CELL_PX, _METER_PX, _COARSER = 8, 40, 4
"""Spacing in image pixels of the grid for lamps and clouds and of the grid that auto exposure meters, and the
reduction of the pictures for metering, so that a grid point represents its surroundings."""

_METER_INTERVAL_S, _BLOCK_S = 0.1, 60.0
"""Interval of metering the scene's brightness, and duration metered at once."""

_STAY_S, _WALK_S = (90.0, 400.0), 1.2
"""Time that the camera stays in front of a picture, and takes to move to the next."""

_CLOUDS, _CLOUD_POWER = ((0.6, 170.0), (0.5, 430.0), (0.4, 1900.0)), 8
"""Depth in ln of the daylight and period in s, and the power of a sine whose positive half is a smooth pulse: each
cloud covers the sun for about a sixth of its period."""

_ROOM_LIGHT = 1.1
"""Amplitude in ln of the spatial variation of the light, which the exposure mostly follows."""

_SHADOW, _SHADOW_PX, _SHADOW_SPEED = np.float32(0.15), 150.0, 0.15
"""Amplitude of cloud shadows in ln, their size in picture pixels, and their drift in radians per s."""

_LAMPS, _OBJECTS = 3, 3
_SPEED = {
    "x": ((450.0, 31.0), (160.0, 9.3), (30.0, 3.1)),
    "y": ((400.0, 37.0), (150.0, 7.9), (30.0, 2.7)),
    "turn": ((0.35, 17.0), (0.08, 4.7)),
    "scale": ((0.18, 41.0), (0.06, 9.1)),
    "tilt_x": ((0.22, 21.0), (0.1, 7.7)),
    "tilt_y": ((0.22, 19.0), (0.1, 8.3)),
}
"""Amplitude and period in s of the oscillations of the view: pixels, radians, ln of the scale, and tilts."""


@dataclass(frozen=True)
class Camera:
    """A camera and its auto exposure.

    ``vignette`` are coefficients of R², R⁴ and R⁶, ``noise`` full well and read noise in electrons. Auto exposure
    sets exposures in factors of ``exposure_step`` (1 for continuous), and corrects the share ``control_gain`` of the
    logarithmic deviation per frame at 20 frames/s.
    """

    response: str
    vignette: tuple[float, float, float]
    noise: tuple[float, float]
    exposure_step: float
    control_gain: float


CAMERAS = {
    "webcam": Camera("srgb", (-0.30, 0.05, -0.10), (3_000.0, 12.0), 1.0, 0.15),
    "industrial": Camera("linear", (-0.10, -0.02, -0.03), (20_000.0, 5.0), 1.02, 0.4),
    "wide": Camera("gamma2.2", (-0.50, 0.10, -0.12), (8_000.0, 8.0), 1.12, 0.25),
    "phone": Camera("filmic", (-0.35, 0.05, -0.15), (5_000.0, 8.0), 1.0, 0.1),
}
"""The cameras by name."""


@dataclass(frozen=True)
class Switch:
    """A change of the camera in mid-film; afterwards, exposures are recorded ``late_frames`` late."""

    at_s: float
    camera: Camera
    late_frames: int = 0


class LongFilm:
    """A film. Iterating yields its frames; their images are rendered, and counted, on access."""

    def __init__(self, camera: Camera, hours: float, rate: float, seed: int, switch: Switch | None = None) -> None:
        self._camera, self._rate, self._seed = camera, rate, seed
        self._count = round(3600 * hours * rate)
        self._switch = switch or Switch(np.inf, camera)
        self._optics = (_Optics(camera, seed), _Optics(self._switch.camera, seed))
        self.vignette, self.response = self._optics[0].vignette, self._optics[0].response
        random = np.random.default_rng([seed, 10])
        self._pictures = [_picture(random) for _ in range(_PICTURES)]
        smaller = [cv2.resize(p, None, fx=1 / _COARSER, fy=1 / _COARSER) for p in self._pictures]
        self._coarse = [cv2.blur(p, (_METER_PX // _COARSER,) * 2) for p in smaller]
        self._phase = {axis: random.uniform(0, 2 * np.pi, len(waves)) for axis, waves in _SPEED.items()}
        self._visits = _visits(3600 * hours, random)
        self._brightness = random.normal(0, 0.6, len(self._visits))
        self._lamps = _Lamps(random)
        self._cloud_phase = random.uniform(0, 2 * np.pi, len(_CLOUDS) + 2)
        self._object_phase = random.uniform(0, 1, (_OBJECTS, 3))
        self.rendered = 0

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[Frame]:
        exposures_ms = list(chain.from_iterable(block.tolist() for block in self._exposures()))[: self._count]
        for index, exposure_ms in enumerate(exposures_ms):
            stamp_s = index / self._rate
            late = self._switch.late_frames if stamp_s >= self._switch.at_s else 0
            render, stated_ms = partial(self._image, index, exposure_ms), exposures_ms[index - late]
            yield Frame(index, stamp_s, stated_ms, f"frame {index}", render, verify=lambda: None)

    # The exposure control.

    def _exposures(self) -> Iterator[FloatArray]:
        """Yield the exposures of one block of frames at a time."""
        block = round(_BLOCK_S * self._rate)
        gain = 1 - (1 - self._camera.control_gain) ** (20 / self._rate)
        step = np.log(self._camera.exposure_step)
        state: float | None = None
        for first in range(0, self._count, block):
            stamps = np.arange(first, first + block) / self._rate
            metered = np.arange(stamps[0] - _METER_INTERVAL_S, stamps[-1] + _METER_INTERVAL_S, _METER_INTERVAL_S)
            light = self._metered(np.maximum(metered, 0.0))
            # Auto exposure does not know the future: between two meterings it uses the earlier one.
            wanted = np.interp(stamps - _METER_INTERVAL_S, metered, np.log(0.16 / light))
            log_exposures = np.empty(block)
            for i, target in enumerate(wanted.tolist()):
                state = target if state is None else state + gain * (target - state)
                log_exposures[i] = state
            if step > 0:
                log_exposures = step * np.round(log_exposures / step)
            yield 10.0 * np.exp(np.clip(log_exposures, -3.0, 2.0))

    def _metered(self, times_s: FloatArray) -> FloatArray:
        """Return the mean radiance that auto exposure meters, shape (times,)."""
        cells = _grid(_METER_PX)
        means = [float(np.mean(self._radiance(float(time_s), cells))) for time_s in times_s]
        return np.asarray(np.maximum(means, 1e-4))

    # The image.

    def _image(self, index: int, exposure_ms: float) -> Image:
        self.rendered += 1
        radiance = self._radiance(index / self._rate)
        self._draw_objects(radiance, index / self._rate)
        optics = self._optics[index / self._rate >= self._switch.at_s]
        radiance *= optics.attenuation
        radiance *= np.float32(exposure_ms / 10.0)
        return optics.sensor.expose(radiance, frame=index)

    def _radiance(self, time_s: float, cells: Float32Array | None = None) -> Float32Array:
        """Return the radiance at every pixel, or at some points of the image, without the moving objects."""
        visit, share = self._place_in_time(time_s)
        seen = self._filmed(visit, time_s, cells)
        if share > 0:
            columns = np.arange(SIZE[0]) if cells is None else cells[0, :, 0]
            beyond = columns >= (1 - share) * SIZE[0]
            seen[:, beyond] = self._filmed(visit + 1, time_s, cells)[:, beyond]
        return seen

    def _place_in_time(self, time_s: float) -> tuple[int, float]:
        """Return the number of the visit, and the share of the view that already shows the next picture."""
        visit = int(np.searchsorted(self._visits, time_s, side="right")) - 1
        until = self._visits[visit + 1] - time_s if visit + 1 < len(self._visits) else np.inf
        return visit, max(0.0, 1 - until / _WALK_S)

    def _filmed(self, visit: int, time_s: float, cells: Float32Array | None) -> Float32Array:
        """Return the radiance of a picture at every pixel, or at some points of the image."""
        number = (visit * 7 + self._seed) % len(self._pictures)
        # Each visit begins at a different point of the picture.
        matrix = self._view(time_s + 1000.0 * visit)
        brightness = np.float32(np.exp(self._brightness[visit]))
        if cells is not None:
            places = cv2.perspectiveTransform(cells.reshape(1, -1, 2), matrix).reshape(cells.shape)
            seen = cv2.remap(
                self._coarse[number], places / _COARSER, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT
            )
            return np.asarray(brightness * seen * self._light(places, time_s), dtype=np.float32)
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        seen = cv2.warpPerspective(self._pictures[number], matrix, SIZE, flags=flags, borderMode=cv2.BORDER_REFLECT)
        grid = _grid(_CELL_PX)
        light = self._light(cv2.perspectiveTransform(grid.reshape(1, -1, 2), matrix).reshape(grid.shape), time_s)
        seen *= cv2.resize(brightness * light, SIZE, interpolation=cv2.INTER_LINEAR)
        return np.asarray(seen, dtype=np.float32)

    def _view(self, time_s: float) -> FloatArray:
        """Return the homography from the image to a picture."""
        x, y, turn, log_scale, tilt_x, tilt_y = (
            sum(a * np.sin(2 * np.pi * time_s / period + p) for (a, period), p in zip(waves, phases, strict=True))
            for waves, phases in zip(_SPEED.values(), self._phase.values(), strict=True)
        )
        to_centre = np.array([[1, 0, -SIZE[0] / 2], [0, 1, -SIZE[1] / 2], [0, 0, 1]])
        tilt = np.array([[1, 0, 0], [0, 1, 0], [tilt_x / SIZE[0], tilt_y / SIZE[0], 1]])
        cos, sin = np.exp(log_scale) * np.cos(turn), np.exp(log_scale) * np.sin(turn)
        middle = _PICTURE_M[0] / TEXEL_M / 2
        placed = np.array([[cos, -sin, middle + x], [sin, cos, middle + y], [0, 0, 1]])
        return np.asarray(placed @ tilt @ to_centre)

    def _draw_objects(self, seen: Float32Array, time_s: float) -> None:
        """Paste patches that move through the view, each for a part of the time."""
        for number, (phase, period, height) in enumerate(self._object_phase):
            progress = (time_s / (15 + 25 * period) + phase) % 1
            if progress > 0.5:
                continue
            edge = 30 + 15 * number
            left = round(progress / 0.5 * (SIZE[0] + edge)) - edge
            top = round(height * (SIZE[1] - edge))
            first, last = max(left, 0), min(left + edge, SIZE[0])
            if last > first:
                patch = self._pictures[number % len(self._pictures)][:edge, first - left : last - left]
                seen[top : top + edge, first:last] = patch * np.float32(np.exp(self._brightness[0]))

    def _light(self, places: Float32Array, time_s: float) -> Float32Array:
        """Return the light at points of a picture, shape (rows, columns, 2): clouds times the lamps that are on."""
        phases = self._cloud_phase
        cloud = -sum(
            depth * max(0.0, np.sin(2 * np.pi * time_s / period_s + phase)) ** _CLOUD_POWER
            for (depth, period_s), phase in zip(_CLOUDS, phases, strict=False)
        )
        drift_x, drift_y = (time_s * _SHADOW_SPEED + phase for phase in phases[-2:])
        shadow = np.sin(places[..., 0] / _SHADOW_PX + drift_x) * np.sin(places[..., 1] / _SHADOW_PX + drift_y)
        return np.asarray(np.exp(np.float32(cloud) + _SHADOW * shadow) * self._lamps.light(places, time_s))


class _Optics:
    """Turns radiance into a camera's images."""

    def __init__(self, camera: Camera, seed: int) -> None:
        full_well, read_noise = camera.noise
        settings = SimulationSettings(
            size=SIZE, seed=seed, full_well_electrons=full_well, read_noise_electrons=read_noise
        )
        self.response: Response = make_response(camera.response)
        self.vignette: Vignette = PolynomialVignette(SIZE, camera.vignette)
        self.sensor = Sensor(self.response, settings)
        self.attenuation = self.vignette.image().astype(np.float32)


class _Lamps:
    """Lamps that each light a part of every picture and are switched at random times."""

    def __init__(self, random: np.random.Generator) -> None:
        # Centre and radius of the lit area in picture pixels, and its light relative to the daylight.
        self._place = random.uniform(0.2, 0.8, (_LAMPS, 2)) * _PICTURE_M[0] / TEXEL_M
        self._reach = random.uniform(200, 700, _LAMPS)
        self._strength = random.uniform(0.3, 1.5, _LAMPS)
        # Time after which a lamp may be switched.
        self._period_s = random.uniform(25, 150, _LAMPS)
        self._seed = int(random.integers(2**31))

    def light(self, places: Float32Array, time_s: float) -> Float32Array:
        total = np.ones(places.shape[:-1], np.float32)
        for number, period_s in enumerate(self._period_s):
            slot = int(time_s / period_s)
            if (slot * 2654435761 + number * 40503 + self._seed) >> 7 & 1:
                squared = np.sum((places - self._place[number].astype(np.float32)) ** 2, axis=-1)
                total += np.float32(self._strength[number]) * np.exp(
                    -squared / np.float32(2 * self._reach[number] ** 2)
                )
        return total


@cache
def _grid(spacing_px: int) -> Float32Array:
    """Return the positions (x, y) of the image's grid points, shape (rows, columns, 2)."""
    x, y = (np.arange(spacing_px / 2 - 0.5, n, spacing_px, dtype=np.float32) for n in SIZE)
    return np.stack(np.meshgrid(x, y), axis=-1)


def _picture(random: np.random.Generator) -> Float32Array:
    """Return the radiance of an unevenly lit, painted wall with panels and posters, shape (2000, 2000)."""
    wall = painted(_PICTURE_M, random, level=float(random.uniform(0.25, 0.6)))
    for number in range(_PANELS):
        size_m = tuple(random.uniform(*_PANEL_M, 2).tolist())
        if number % 2:
            panel = single(str(random.choice(_POSTERS)), size_m)
        else:
            panel = painted(size_m, random, level=float(np.exp(random.uniform(*np.log(_PANEL_LEVELS)))))
        top, left = (int(random.integers(0, n - m)) for n, m in zip(wall.shape, panel.shape, strict=True))
        wall[top : top + panel.shape[0], left : left + panel.shape[1]] = panel
    x, y = np.meshgrid(*(np.linspace(0, 2 * np.pi, n, dtype=np.float32) for n in wall.shape[::-1]))
    phases = random.uniform(0, 2 * np.pi, 2).astype(np.float32)
    wall *= np.exp(np.float32(_ROOM_LIGHT) * np.sin(2 * x + phases[0]) * np.sin(2 * y + phases[1]))
    # An edge between two panels isn't sharper than a lens would make it.
    return np.ascontiguousarray(cv2.GaussianBlur(wall, (0, 0), 1.0))


def _visits(seconds: float, random: np.random.Generator) -> FloatArray:
    """Return the time of each visit to a picture, the first at 0."""
    stays = random.uniform(*_STAY_S, int(seconds / _STAY_S[0]) + 2)
    begins = np.concatenate([[0.0], np.cumsum(stays)])
    return begins[begins <= seconds]
