"""Summarise how well the exposures explain the brightness changes, and what remains: flicker, jumps, drift."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ospc.arrays import FloatArray, IntArray
from ospc.errors import plain
from ospc.exposures.flicker import Flicker, find_flicker, without_waves
from ospc.exposures.lag_likelihood import LagFit
from ospc.exposures.lag_selection import LagEstimate
from ospc.exposures.table import exposure_cycle
from ospc.numerics.robust import robust_scale
from ospc.photometry.coverage import ExposureRatios
from ospc.settings.brightness import (
    CONTRADICTING_PAIR_LOG,
    DRIFT_FRAMES,
    DRIFT_STEP_FRAMES,
    EXPLAINED_POINTS,
    EXPLAINED_SIGMAS,
    HARMONIC_TOLERANCE_TURNS,
    JUMP_FRAMES,
    JUMP_SIGMAS,
    LASTING_JUMP_SHARE,
    MAX_JUMPS_SHARE,
    MIN_JUMP_LOG,
    MIN_JUMP_SAMPLES,
    MIN_STALE_PAIRS,
    MODERATE_JUMP_LOG,
    NOTABLE_RMS_LOG,
    REPORTED_FLICKER_SHARE,
    REPORTED_FLICKER_TOTAL_SHARE,
    RMS_KEPT_SHARE,
    STALE_DRIFT_LOG,
    UNCHANGED_EXPOSURE_LOG,
)
from ospc.settings.exposures import MAX_UNEXPLAINED_SHARE


@dataclass(frozen=True)
class Jump:
    """A lasting jump in ln brightness of the same scene points.

    ``frame`` is the first frame that certainly shows it; it lies between this frame and the one ``span_frames``
    before.
    """

    frame: int
    log_change: float
    span_frames: int = 1

    @property
    def in_words(self) -> str:
        """The jump as the end of a sentence."""
        before = self.frame - self.span_frames
        where = f"at frame {self.frame}" if self.span_frames == 1 else f"between frames {before} and {self.frame}"
        factor = float(np.exp(self.log_change))
        moderate = abs(self.log_change) < MODERATE_JUMP_LOG
        change = f"{factor - 1:+.0%}" if moderate else f"a factor of {plain(factor, 2)}"
        return f"brightness jumps by {change} {where} relative to what the exposures predict"


@dataclass(frozen=True)
class BrightnessReport:
    """How the brightness of the same scene points changes, and what explains it."""

    change_rms_log: float
    """Root mean square change of ln grey from one frame to the next."""
    unexplained_rms_log: float
    """Root mean square of the part that exposures (shifted by the lag) and flicker do not explain."""
    unexplained_share: float
    """Share of the energy of all changes that exposures do not explain; NaN if brightness does not change."""
    drift_at_constant_exposure_log: float
    """Largest sum of unexplained changes within :data:`DRIFT_FRAMES` while the exposure stays constant."""
    stale: bool
    """Whether brightness changes while the recorded exposures do not."""
    fits_badly: bool
    """Whether exposures leave much of the brightness unexplained, even at the lag that fits best."""
    flicker: tuple[Flicker, ...]
    """Periodic changes that the exposures do not explain, strongest first."""
    jumps: tuple[Jump, ...] = ()
    """Lasting jumps that the exposures do not explain, in frame order."""
    momentary: tuple[int, ...] = ()
    """Frames that differ from those before and after them, as by the flash of another camera, in order."""

    @property
    def largest_jump(self) -> Jump | None:
        """The largest of the jumps; None without any."""
        return max(self.jumps, key=lambda jump: abs(jump.log_change), default=None)


def brightness_report(lag: LagEstimate, log_exposure: FloatArray) -> BrightnessReport | None:
    """Compare brightness with ln exposures, shape (frames,); None if too few frames could be compared."""
    if lag.fit is None or not len(lag.frame):
        return None
    fit = lag.fit
    flicker = _reported_flicker(lag, fit, exposure_cycle(log_exposure))
    unexplained = without_waves(lag.frame, fit.unexplained, [f.cycles_per_frame for f in flicker])
    shift = lag.candidates[0] if lag.candidates else 0
    change = log_exposure[lag.frame + 1 + shift] - log_exposure[lag.frame + shift]
    stays = np.abs(change) < UNCHANGED_EXPOSURE_LOG
    unchanged, drift = unexplained[stays], _drift(unexplained[stays], lag.frame[stays])
    constant = bool(stays.all())
    stale = len(unchanged) >= MIN_STALE_PAIRS and _rms(unchanged) > NOTABLE_RMS_LOG
    unexplained_rms_log = _rms(unexplained)
    much = fit.unexplained_share > MAX_UNEXPLAINED_SHARE and unexplained_rms_log > NOTABLE_RMS_LOG
    return BrightnessReport(
        change_rms_log=_rms(fit.observed),
        unexplained_rms_log=unexplained_rms_log,
        unexplained_share=fit.unexplained_share,
        drift_at_constant_exposure_log=drift,
        stale=bool(stale or (constant and drift > STALE_DRIFT_LOG)),
        fits_badly=bool(much and (lag.frames is not None or lag.state == "ambiguous")),
        flicker=flicker,
        jumps=_jumps(lag.frame, unexplained),
        momentary=_momentary(lag.frame, unexplained),
    )


def _reported_flicker(lag: LagEstimate, fit: LagFit, cycle: int | None) -> tuple[Flicker, ...]:
    """Return the flicker to report: strong frequencies that are not harmonics of the exposure cycle."""
    found = lag.flicker
    if not found:
        one = find_flicker(lag.frame, fit.unexplained)
        found = () if one is None else (one,)

    def is_harmonic(flicker: Flicker) -> bool:
        if cycle is None:
            return False
        turns = flicker.cycles_per_frame * cycle
        return abs(turns - round(turns)) < HARMONIC_TOLERANCE_TURNS

    reported = tuple(f for f in found if f.share >= REPORTED_FLICKER_SHARE and not is_harmonic(f))
    if not reported:
        return ()
    rest = without_waves(lag.frame, fit.unexplained, [f.cycles_per_frame for f in reported])
    return reported if np.var(rest) <= (1 - REPORTED_FLICKER_TOTAL_SHARE) * np.var(fit.unexplained) else ()


def _jumps(frame: IntArray, unexplained: FloatArray) -> tuple[Jump, ...]:
    """Return unusually large changes that last for some frames; none if such changes are frequent."""
    if len(unexplained) < 2 * JUMP_FRAMES:
        return ()
    lasting = [at for at in _large(unexplained) if _lasts(frame, unexplained, at)]
    if len(lasting) > MAX_JUMPS_SHARE * len(unexplained):
        return ()
    return tuple(Jump(int(frame[at]) + 1, float(unexplained[at])) for at in lasting)


def _momentary(frame: IntArray, unexplained: FloatArray) -> tuple[int, ...]:
    """Return the frames between a large change and one that reverses it within some frames."""
    large = _large(unexplained)
    found: set[int] = set()
    for at, later in pairwise(large):
        change, back = float(unexplained[at]), float(unexplained[later])
        reverses = abs(change + back) < (1 - LASTING_JUMP_SHARE) * min(abs(change), abs(back))
        if reverses and frame[later] - frame[at] <= JUMP_FRAMES:
            found.update(range(int(frame[at]) + 1, int(frame[later]) + 1))
    return tuple(sorted(found))


def _large(unexplained: FloatArray) -> list[int]:
    """Return the indices of unusually large changes."""
    usual = robust_scale(unexplained - np.median(unexplained))
    return np.flatnonzero(np.abs(unexplained) > max(JUMP_SIGMAS * usual, MIN_JUMP_LOG)).tolist()


def largest_jump_of_pairs(ratios: ExposureRatios, momentary: Sequence[int] = ()) -> Jump | None:
    """Return the largest jump that pairs of frames certainly show, whose exposure ratios a fit has estimated.

    Consecutive frames do not show every jump, because most frames are not processed. None if there is no such jump.
    Pairs with ``momentary`` frames, which differ from those before and after them, show no lasting jump.
    """
    if ratios.log_sigma is None:
        return None
    change, size = -ratios.log_residual, np.abs(ratios.log_residual)
    lasting = ~np.isin(ratios.frames, momentary).any(axis=1)
    certain = lasting & (ratios.samples >= MIN_JUMP_SAMPLES) & (size > JUMP_SIGMAS * ratios.log_sigma)
    contradicting = np.flatnonzero(certain & (size > CONTRADICTING_PAIR_LOG))
    if not len(contradicting):
        return None
    largest = contradicting[np.argmax(size[contradicting])]
    before, after = ratios.frames[largest]
    for pair in contradicting[np.argsort(np.ptp(ratios.frames[contradicting], axis=1), kind="stable")]:
        first, second = ratios.frames[pair]
        same_sign = (change[pair] > 0) == (change[largest] > 0)
        if same_sign and max(first, before) < min(second, after):  # it may show the same jump
            before, after = max(first, before), min(second, after)
    return Jump(int(after), float(change[largest]), int(after - before))


def unrefuted(jumps: Sequence[Jump], ratios: ExposureRatios, lag_frames: int) -> tuple[Jump, ...]:
    """Return the jumps that no pair of frames, whose exposure ratio a fit has estimated, refutes.

    Of the pairs across a jump that are precise enough to show it, the shortest decides. If exposures were moved by a
    lag, their jumps lie that many frames before those of the recorded exposures.
    """
    # After a large step of the exposure, few points are neither too dark nor too bright, so that consecutive frames
    # cannot be compared, and nothing but the pairs shows whether the step is real.
    if (sigma := ratios.log_sigma) is None:
        return tuple(jumps)
    first, last = ratios.frames.min(axis=1), ratios.frames.max(axis=1)

    def is_refuted(jump: Jump) -> bool:
        before, after = jump.frame - jump.span_frames - max(lag_frames, 0), jump.frame - min(lag_frames, 0)
        half = abs(jump.log_change) / 2
        across = np.flatnonzero((first <= before) & (last >= after) & (JUMP_SIGMAS * sigma < half))
        if not len(across):
            return False
        shortest = across[np.argmin((last - first)[across])]
        return bool(abs(ratios.log_residual[shortest]) < half)

    return tuple(jump for jump in jumps if not is_refuted(jump))


def largest_error_of_points(ratios: ExposureRatios) -> float | None:
    """Return the error of ln brightness, as a fit explains it, that few points exceed; None if it is notable.

    It is None for few pairs of frames, too, and the larger of that of all points and of those of equal exposure.
    """
    # Brightness changes are compared through a typical response, from which extreme ones differ too much, and in
    # thumbnails, in which regular facades are easily registered wrongly. A fit is subject to neither.
    if len(ratios.samples) < MIN_STALE_PAIRS:
        return None
    by_chance = 0.0 if ratios.log_sigma is None else EXPLAINED_SIGMAS * ratios.log_sigma
    error = np.abs(ratios.log_residual)
    # Points are counted rather than pairs, because a pair whose registration failed has few.
    error, relative, metadata = (
        np.repeat(values, ratios.samples)
        for values in (error, error / np.maximum(NOTABLE_RMS_LOG, by_chance), ratios.metadata)
    )
    unchanged = np.abs(np.log(metadata)) < UNCHANGED_EXPOSURE_LOG
    parts = [part for part in (np.ones_like(unchanged), unchanged) if part.any()]
    if any(np.quantile(relative[part], EXPLAINED_POINTS) > 1 for part in parts):
        return None
    return max(float(np.quantile(error[part], EXPLAINED_POINTS)) for part in parts)


def _lasts(frame: IntArray, unexplained: FloatArray, at: int) -> bool:
    """Return whether most of a change persists over the frames around it, with frames before and after to show it."""
    # A passing hand, or a single wrong exposure, is followed at once by the opposite change. At the first frames that
    # can be compared, in a sweep from white or black, few points are exposed well.
    near = (np.abs(frame - frame[at]) <= JUMP_FRAMES) & (frame != frame[at])
    sides = [unexplained[near & side] for side in (frame < frame[at], frame > frame[at])]
    change = float(unexplained[at])
    return all(len(side) and (change + float(side.sum())) / change > LASTING_JUMP_SHARE for side in sides)


def _rms(values: FloatArray) -> float:
    """Return the root mean square without the largest values."""
    squared = np.sort(values**2)
    return float(np.sqrt(squared[: max(1, int(RMS_KEPT_SHARE * len(squared)))].mean()))


def _drift(change: FloatArray, frame: IntArray) -> float:
    """Return the largest range of the cumulative change over consecutive frames within :data:`DRIFT_FRAMES`."""
    pieces = np.split(change, np.flatnonzero(np.diff(frame) != 1) + 1)
    largest = 0.0
    for piece in pieces:
        total = np.concatenate([[0.0], np.cumsum(piece)])
        for start in range(0, max(1, len(total) - DRIFT_FRAMES), DRIFT_STEP_FRAMES):
            largest = max(largest, float(np.ptp(total[start : start + DRIFT_FRAMES + 1])))
    return largest
