"""Recordings of a drawn wall, independent of the project's simulator, with known exposures and defects."""

from __future__ import annotations

import pickle
from copy import deepcopy
from dataclasses import dataclass, field, fields
from functools import lru_cache

import cv2
import numpy as np

from ospc.arrays import Image
from ospc.exposures.brightness_history import BrightnessHistory
from ospc.exposures.evidence import evidence_of_images
from ospc.exposures.findings import ExposureFindings
from ospc.exposures.lag_choice import LagChoice
from ospc.exposures.verdicts import findings_from
from ospc.photometry.coverage import ExposureRatios
from ospc.photometry.verdict import EffectEstimate
from ospc.recording import ArrayRecording
from ospc.settings import DefaultSettings

SIZE, LARGE, LARGEST = (96, 72), (128, 96), (160, 120)
_WALL_PX = 700
_MOST_OBSERVED = 16


@dataclass(frozen=True, eq=False)
class Film:
    """Settings of a recording of the wall.

    Attributes
    ----------
    log_exposure
        ln of the true exposure of every frame, shape (frames,).
    lag
        The metadata of frame i contain the exposure of frame i − lag.
    gamma
        M = irradiance ** (1 / gamma).
    noise
        Standard deviation of the noise in grey levels.
    speed_px
        Approximate motion of the image from one frame to the next.
    hidden_log_gain
        ln of a gain missing from the metadata, for every frame.
    metadata_error
        Standard deviation of the error of the recorded exposures, in ln.
    black
        True where the image is always black, shape (h, w).
    movers
        Number of discs moving in front of the wall.
    size
        Width and height of the images.
    seed
        Seed of all random numbers.
    """

    log_exposure: np.ndarray
    lag: int = 0
    gamma: float = 2.2
    noise: float = 1.0
    speed_px: float = 2.0
    hidden_log_gain: np.ndarray | float = 0.0
    metadata_error: float = 0.0
    black: np.ndarray | None = field(default=None, repr=False)
    movers: int = 0
    max_grey: int = 255
    size: tuple[int, int] = SIZE
    seed: int = 0

    def recording(self) -> ArrayRecording:
        images, error = self.images()
        return ArrayRecording(images, self.exposures_ms(error), np.arange(len(images)) / 20, max_grey=self.max_grey)

    def exposures_ms(self, error: np.ndarray) -> np.ndarray:
        """Return the recorded exposures, given their errors as from :meth:`images`."""
        written = np.exp(self.log_exposure + error * self.metadata_error)
        return 10 * written[np.clip(np.arange(len(written)) - self.lag, 0, len(written) - 1)]

    @property
    def look(self) -> bytes:
        """All settings that the images depend on."""
        others = {"lag", "metadata_error"}
        return pickle.dumps([getattr(self, each.name) for each in fields(self) if each.name not in others])

    def images(self) -> tuple[list[Image], np.ndarray]:
        """Return the images, and standard normal errors of their exposures, shape (frames,)."""
        wall, rng = deepcopy(_wall(self.seed))
        place = self._path()
        frames, signal = len(self.log_exposure), self.log_exposure + self.hidden_log_gain
        width, height = self.size
        dtype = np.uint8 if self.max_grey == 255 else np.uint16
        discs = [
            (rng.uniform(0, 1, 2) * self.size, rng.uniform(-2, 2, 2), rng.uniform(0.05, 0.6))
            for _ in range(self.movers)
        ]
        images = []
        for i in range(frames):
            light = cv2.getRectSubPix(wall, self.size, place[i].tolist())
            for start, step, value in discs:
                x, y = ((start + i * step) % self.size).astype(int).tolist()
                cv2.circle(light, (x, y), 8, value, -1)
            grey = np.clip(light * np.exp(signal[i]), 0, 1) ** (1 / self.gamma)
            if self.black is not None:
                grey = np.where(self.black, 0.0, grey)
            value = grey * self.max_grey + rng.normal(0, self.noise * self.max_grey / 255, (height, width))
            images.append(np.clip(np.rint(value), 0, self.max_grey).astype(dtype))
        return images, rng.normal(0, 1, frames)

    def _path(self) -> np.ndarray:
        time = np.arange(len(self.log_exposure))
        angle = self.speed_px * time / 60
        wide = np.stack([60 * np.sin(angle) + 25 * np.sin(2.3 * angle), 50 * np.cos(0.8 * angle)], axis=1)
        shake = np.stack([np.sin(0.9 * time), np.cos(0.7 * time)], axis=1) * min(1.0, self.speed_px)
        return _WALL_PX / 2 + wide * (self.speed_px > 0) + shake


_OBSERVED: dict[bytes, tuple[BrightnessHistory, np.ndarray]] = {}


def observed(film: Film) -> tuple[BrightnessHistory, np.ndarray]:
    """Return the brightness history of a film and ln of its recorded exposures; films of one look share a history."""
    if film.look not in _OBSERVED:
        (images, error), history = film.images(), BrightnessHistory()
        preprocess = DefaultSettings().preprocessor()
        for frame in ArrayRecording(images, np.ones(len(images)), max_grey=film.max_grey):
            history.observe(preprocess.thumbnail(frame))
        _OBSERVED[film.look] = history, error
        if len(_OBSERVED) > _MOST_OBSERVED:
            del _OBSERVED[next(iter(_OBSERVED))]
    history, error = _OBSERVED[film.look]
    return history, np.log(film.exposures_ms(error))


def found(film: Film, choice: LagChoice = "auto", stated_log_exposure: np.ndarray | None = None) -> ExposureFindings:
    """Assess the exposures of a film without the rest of a run."""
    history, stated = observed(film)
    return findings_from(
        evidence_of_images(history.changes, stated if stated_log_exposure is None else stated_log_exposure, choice)
    )


def fitted(
    told: ExposureFindings, *effects: EffectEstimate, ratios: ExposureRatios | None = None
) -> ExposureFindings:
    """Return findings that also follow from a fit with these effects and exposure ratios."""
    return findings_from(told.evidence.with_fit(effects, ExposureRatios.none() if ratios is None else ratios))


@lru_cache(maxsize=16)
def _wall(seed: int) -> tuple[np.ndarray, np.random.Generator]:
    """Draw uniform patches of many sizes, with a median brightness of about 0.2; return the generator too."""
    rng = np.random.default_rng(seed)
    wall = np.zeros((_WALL_PX, _WALL_PX), np.float32)
    for octave in range(2, 6):
        small = rng.standard_normal((2**octave, 2**octave)).astype(np.float32)
        wall += cv2.resize(small, (_WALL_PX, _WALL_PX), interpolation=cv2.INTER_CUBIC) * 0.3
    for _ in range(150):
        x, y = rng.integers(0, _WALL_PX, 2).tolist()
        w, h = rng.integers(8, 70, 2).tolist()
        cv2.rectangle(wall, (x, y), (x + w, y + h), float(rng.normal(0, 0.8)), -1)
    wall = cv2.GaussianBlur(wall, (0, 0), 0.8)
    return 0.2 * np.exp(0.6 * (wall - np.median(wall)) / wall.std()), rng


def wandering(frames: int, seed: int = 0, step: float = 0.06) -> np.ndarray:
    """Return ln of exposures that drift as with auto exposure, shape (frames,)."""
    rng = np.random.default_rng(seed)
    log_exposure = np.zeros(frames)
    for i in range(1, frames):
        log_exposure[i] = 0.97 * log_exposure[i - 1] + step * rng.standard_normal()
    return np.clip(log_exposure, -1.2, 0.9)


def jumping(frames: int, seed: int = 0, every: int = 9) -> np.ndarray:
    """Return ln of exposures that stay constant for some frames and then jump, shape (frames,)."""
    rng = np.random.default_rng(seed)
    return np.repeat(rng.uniform(-0.8, 0.7, frames // every + 1), every)[:frames]
