"""Has the camera changed? New pairs of frames are predicted by what was known before, and the errors are explained.

A fit from the beginning of an epoch predicts the ratio of the two grey levels of every scene point in a new pair of
frames. If the camera is the same, the prediction errors are noise. If its vignette or its response is another, they
depend on the radius or on the grey level within each pair. If exposures are suddenly written late, the errors of
whole pairs are those of other exposures. Light that changes, by clouds or lamps, changes all points of a pair alike:
it is subtracted, and never mistaken for a change of the camera.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ospc.arrays import FloatArray
from ospc.estimation.fit import Fit
from ospc.exposures.table import ExposureTable
from ospc.observations import ExposedObservations, Observations

WINDOW_PAIRS = 24
"""Pairs of frames that are tested together: some eight seconds of film at 20 frames/s, one at the beginning."""

MOST_USUAL_ERRORS = 480
"""Pairs whose errors say what is usual: twenty windows."""

FEWEST_POINTS = 40
"""Scene points of a pair below which its registration is not trusted."""

LONGEST_PAIR_FRAMES = 400
"""Frames between the two of a pair beyond which a change can hide between them."""

MIN_EFFECT_LOG = 0.04
"""Smallest change, in ln of irradiance, that counts: a refocused lens changes the corners by more, drift by less."""

MIN_SIGMAS = 6.0
"""Standard deviations, by the scatter between the pairs of the window, that a change must exceed."""

MIN_SIGMAS_OF_HALF = 3.0
"""The same for each half of the window: what happens once, such as a hand in the picture, is no change."""

SYSTEMATIC_LOG = 0.006
"""Standard deviation, in ln, by which registration is wrong in ways that pairs of a window have in common."""

RIDGE = 1.0
"""Weight of the belief that nothing changed, in scene points: it keeps what no pair shows at zero."""

OUTLIER_LOG = 0.3
"""Errors of prediction far beyond this, in ln, are moving objects or wrong registration."""

LAGS = (-3, -2, -1, 1, 2, 3)
"""Changes of the lag that are tried, in frames."""

LAG_FLOOR_LOG = 0.006
"""Mean error of whole pairs, in ln, below which exposures are not suspected to be late: neighbours differ by no more
than some per cent of exposure."""

LAG_GAIN = 3.0
"""How many times smaller another lag must make the errors of whole pairs."""

NEIGHBOUR_FRAMES = 8
"""Frames between the two of a pair within which light changes little: the exposure explains the brightness."""

FEWEST_NEIGHBOURS = 8
"""Pairs of neighbours in each half of the window by which the slope of brightness against exposure is measured."""

MIN_SLOPE_CHANGE = 0.15
"""Smallest change of that slope, relative: another response changes it by more, and clouds by less than a frame's."""

MIN_SLOPE_ERROR_LOG = 0.01
"""Mean error of pairs of neighbours, in ln, below which the slope is not suspected to have changed."""

SLOPE_GAIN = 8.0
"""How many times larger than usual the errors must be."""

MAX_SLOPE_REST = 0.3
"""Share of the energy of the errors that the slope may leave unexplained."""

_KNOTS = np.array([0.0, 0.15, 0.35, 0.6, 0.85, 1.0])
"""Grey levels between which a change of ln g is taken to be linear."""


@dataclass(frozen=True)
class Change:
    """A change of the camera.

    Attributes
    ----------
    frame
        Number of the first frame after it, as nearly as it can be told.
    found
        Number of the frame at which it was found.
    part
        What changed: ``"response"``, ``"vignette"`` or ``"exposures"``.
    text
        What changed, by how much and since which frame, as one sentence.
    """

    frame: int
    found: int
    part: str
    text: str


@dataclass(frozen=True)
class _Pair:
    """What a pair of frames says about the errors of prediction.

    Attributes
    ----------
    observations
        Its scene points.
    matrix, vector
        ΦᵀΦ and Φᵀρ of the errors ρ in the basis of changes Φ, both without the mean of the pair.
    carried
        ΦᵀX: how errors of the reference's parameters carry over.
    error
        Median error of the whole pair.
    """

    observations: ExposedObservations
    matrix: FloatArray
    vector: FloatArray
    carried: FloatArray
    error: float

    @property
    def frames(self) -> tuple[int, int]:
        return int(self.observations.frame[0]), int(self.observations.frame[1])


@dataclass
class ChangeDetector:
    """Compares each new pair of frames with what the epoch's fit predicts.

    Attributes
    ----------
    reference
        The fit that predicts; None before there is one.
    observations
        Those of the latest pairs of frames.
    usual_errors
        Absolute errors of whole pairs that have left the window.
    """

    reference: Fit | None = None
    observations: list[ExposedObservations] = field(default_factory=list, repr=False)
    usual_errors: list[float] = field(default_factory=list, repr=False)

    def __post_init__(self) -> None:
        """Predict the pairs of a state."""
        self._pairs = [] if self.reference is None else [_pair(o, self.reference) for o in self.observations]

    def rely_on(self, fit: Fit) -> None:
        """Predict by another fit from now on."""
        self.reference = fit
        self._pairs = [_pair(observations, fit) for observations in self.observations]

    def observe(self, latest: Observations, exposures: ExposureTable) -> Change | None:
        """Take the observations of the latest pair, and return the change of the camera that they suggest, if any.

        It is to be confirmed, :meth:`suggested`, after a fit to everything, the latest pairs included: a camera that
        is the same has one fit that predicts all of them, however new the grey levels and radii are that they show.
        """
        if self.reference is None or len(latest.starts) < FEWEST_POINTS:
            return None
        exposed = latest.with_exposures(exposures)
        number0, number1 = int(latest.frame[0]), int(latest.frame[1])
        if not len(exposed) or number1 - number0 > LONGEST_PAIR_FRAMES:
            return None
        self.observations = [*self.observations, exposed][-2 * WINDOW_PAIRS :]
        self._pairs = [*self._pairs, _pair(exposed, self.reference)][-2 * WINDOW_PAIRS :]
        change = self.suggested(exposures)
        if change is None:
            self.usual_errors = [*self.usual_errors, abs(self._pairs[0].error)][-MOST_USUAL_ERRORS:]
        return change

    def suggested(self, exposures: ExposureTable) -> Change | None:
        """Return the change of the camera that the latest pairs suggest, if any."""
        window = self._pairs[-WINDOW_PAIRS:]
        if len(window) < WINDOW_PAIRS:
            return None
        return (
            self._late_exposures(window, exposures)
            or self._changed_curves(window)
            or self._changed_exposure_slope(window, exposures)
        )

    def _changed_curves(self, window: list[_Pair]) -> Change | None:
        half = len(window) // 2
        whole, halves = self._solved(window), [self._solved(part) for part in (window[:half], window[half:])]
        for part, columns in (("vignette", slice(len(_KNOTS), None)), ("response", slice(0, len(_KNOTS)))):
            effect = _largest_effect(whole[0], part, window)
            if abs(effect) < MIN_EFFECT_LOG or _sigmas(*whole, columns) < MIN_SIGMAS:
                continue
            if min(_sigmas(*solved, columns) for solved in halves) < MIN_SIGMAS_OF_HALF:
                continue
            if halves[0][0][columns] @ halves[1][0][columns] <= 0:
                continue
            first = self._first_frame(whole[0])
            text = f"the {part} changed at about frame {first}, by {np.expm1(effect):+.0%}"
            return Change(first, max(window[-1].frames), part, text)
        return None

    def _solved(self, pairs: list[_Pair]) -> tuple[FloatArray, FloatArray]:
        """Return the change that explains the errors of pairs, shape (c,), and its covariance, shape (c, c)."""
        assert self.reference is not None
        matrix = np.sum([pair.matrix for pair in pairs], axis=0)
        inverse = np.linalg.inv(matrix + RIDGE * np.eye(len(matrix)))
        change = inverse @ np.sum([pair.vector for pair in pairs], axis=0)
        scores = np.stack([pair.vector - pair.matrix @ change for pair in pairs])
        carried = inverse @ np.sum([pair.carried for pair in pairs], axis=0)
        covariance = inverse @ (scores.T @ scores) @ inverse + carried @ self.reference.covariance @ carried.T
        # Where pairs say nothing, the ridge keeps the change at zero, and so it says nothing about the certainty.
        return change, covariance + SYSTEMATIC_LOG**2 * np.eye(len(matrix))

    def _first_frame(self, change: FloatArray) -> int:
        """Return the frame from which on the change explains the errors better than no change."""
        pairs = self._pairs
        gain = [change @ (2 * pair.vector - pair.matrix @ change) for pair in pairs]
        since = int(np.argmax(np.cumsum(gain[::-1])[::-1]))
        return min(pairs[since].frames[1], *(pair.frames[1] for pair in pairs[since:]))

    def _late_exposures(self, window: list[_Pair], exposures: ExposureTable) -> Change | None:
        usual = float(np.median(self.usual_errors)) if self.usual_errors else 0.0
        errors = np.array([pair.error for pair in window])
        halves = (slice(0, len(window) // 2), slice(len(window) // 2, None))
        present = [float(np.mean(np.minimum(np.abs(errors[half]), OUTLIER_LOG))) for half in halves]
        if min(present) < max(LAG_FLOOR_LOG, LAG_GAIN * usual):
            return None
        frames = np.array([pair.frames for pair in window])
        stated = exposures.log_exposure_of(frames)
        for lag in LAGS:
            other = exposures.with_lag(exposures.lag_frames + lag).log_exposure_of(frames)
            moved = errors + np.diff(stated, axis=1)[:, 0] - np.diff(other, axis=1)[:, 0]
            moved = moved[np.isfinite(moved)]
            if len(moved) < len(window) - max(LAGS):
                continue
            halved = (moved[: len(moved) // 2], moved[len(moved) // 2 :])
            left = [float(np.mean(np.minimum(np.abs(part), OUTLIER_LOG))) for part in halved]
            if all(LAG_GAIN * after < before for before, after in zip(present, left, strict=True)):
                first = int(frames.min())
                words = f"{abs(lag)} frame{'' if abs(lag) == 1 else 's'} {'later' if lag > 0 else 'earlier'}"
                text = f"the exposures are written {words} than before, since about frame {first}"
                return Change(first, int(frames.max()), "exposures", text)
        return None

    def _changed_exposure_slope(self, window: list[_Pair], exposures: ExposureTable) -> Change | None:
        """Return a change of the response: brightness follows the exposure more or less than before."""
        usual = float(np.median(self.usual_errors)) if self.usual_errors else 0.0
        near = [pair for pair in window if pair.frames[1] - pair.frames[0] <= NEIGHBOUR_FRAMES]
        if len(near) < 2 * FEWEST_NEIGHBOURS:
            return None
        halves = (near[: len(near) // 2], near[len(near) // 2 :])
        slopes = [_slope_change(half, exposures, usual) for half in halves]
        if slopes[0] is None or slopes[1] is None or slopes[0] * slopes[1] <= 0:
            return None
        first = min(min(pair.frames) for pair in near)
        text = (
            f"the response changed, or a gain that the exposures do not hold, since about frame {first}: brightness "
            f"follows the exposure by {(slopes[0] + slopes[1]) / 2:+.0%}"
        )
        return Change(first, max(max(pair.frames) for pair in window), "response", text)


def _slope_change(pairs: list[_Pair], exposures: ExposureTable, usual: float) -> float | None:
    """Return by how much more than predicted brightness follows the exposure, relative; None where it does not."""
    error = np.array([pair.error for pair in pairs])
    change = np.diff(exposures.log_exposure_of(np.array([pair.frames for pair in pairs])), axis=1)[:, 0]
    known = np.isfinite(change)
    error, change = error[known], change[known]
    if len(error) < FEWEST_NEIGHBOURS or np.abs(error).mean() < max(MIN_SLOPE_ERROR_LOG, SLOPE_GAIN * usual):
        return None
    slope = float(error @ change) / max(float(change @ change), 1e-12)
    rest = error - slope * change
    follows = float(rest @ rest) <= MAX_SLOPE_REST * float(error @ error)
    return slope if follows and abs(slope) >= MIN_SLOPE_CHANGE else None


def _pair(observations: ExposedObservations, fit: Fit) -> _Pair:
    basis, seen = fit.response_basis, observations
    log_g = basis.log_of(fit.response_parameters)
    log_irradiance = fit.vignette_basis.log_value(fit.vignette_parameters, seen.position) + seen.log_exposure
    log_radiance = np.interp(seen.grey, basis.grid, log_g) - log_irradiance
    # The basis is evaluated at the grey levels predicted from both observations: at those measured, its noise would
    # be that of the errors, and every pair of nearly equal exposures would seem to have changed.
    predicted = np.repeat((log_radiance[0::2] + log_radiance[1::2]) / 2, 2) + log_irradiance
    grey = np.interp(predicted, log_g, basis.grid)
    vignette_rows = fit.vignette_basis.jacobian(fit.vignette_parameters, seen.position)
    rows = np.concatenate([basis.log_rows(grey), -vignette_rows], axis=1)
    squared = np.sum(seen.position**2, axis=1)
    hats = np.stack([np.interp(grey, _KNOTS, row) for row in np.eye(len(_KNOTS))], axis=1)
    columns = np.column_stack([-hats, squared, squared**2])
    error, basis_of, carried = (_difference(values) for values in (log_radiance, columns, -rows))
    middle = float(np.median(error))
    # A predicted error has the weight of a well-measured one, whatever it is: a change may be large.
    weight = (1 / (1 + ((error - middle) / OUTLIER_LOG) ** 2))[:, None]
    root = np.sqrt(weight)

    def centred(values: FloatArray) -> FloatArray:
        return np.asarray(root * (values - np.sum(weight * values, axis=0) / weight.sum()))

    phi, rho, x = centred(basis_of), centred(error[:, None])[:, 0], centred(carried)
    return _Pair(observations, phi.T @ phi, phi.T @ rho, phi.T @ x, middle)


def _difference(values: FloatArray) -> FloatArray:
    """Return the second observation of each point less the first, of values of pairs, shape (2 n, …) -> (n, …)."""
    return np.asarray(values[1::2] - values[0::2])


def _sigmas(change: FloatArray, covariance: FloatArray, columns: slice) -> float:
    """Return how many standard deviations a part of a change is from zero, root mean square over its parameters."""
    part = change[columns]
    return float(np.sqrt(part @ np.linalg.solve(covariance[columns, columns], part) / len(part)))


def _largest_effect(change: FloatArray, part: str, window: list[_Pair]) -> float:
    """Return the largest change of ln V, or of ln g between two grey levels, where the window has observations."""
    if part == "vignette":
        radius = np.concatenate([np.linalg.norm(pair.observations.position, axis=1) for pair in window])
        squared = np.linspace(0, float(np.quantile(radius, 0.98)), 21) ** 2
        values = change[-2] * squared + change[-1] * squared**2
    else:
        grey = np.concatenate([pair.observations.grey for pair in window])
        values = np.interp(np.quantile(grey, np.linspace(0.05, 0.95, 19)), _KNOTS, change[: len(_KNOTS)])
        values = values - np.median(values)
    return float(values[np.argmax(np.abs(values))])
