"""Grundmann, McClanahan, Kang and Essa, "Post-processing approach for radiometric self-calibration of video", 2013.

A camera that adapts its tone curve has another response in every frame: a mixture of responses at key frames, with
weights w that change linearly in between. For a point with grey levels M and M' in successive frames t and t',

    Σ wₖ(t) ln gₖ(M) − Σ wₖ(t') ln gₖ(M') = K,    ln gₖ = g₀ + Σ cₖᵢ hᵢ

is linear in all cₖ and in the exposure difference K of every two frames. It is solved by iteratively reweighted least
squares. The publication tracks by pyramidal Lucas–Kanade, and balances tracks over the image and over grey levels; so
do the tracks and weights here. The exponent is fixed by one point of the response; without it, by that of the mean
curve. There is no vignette. Not verified: the publication's distance of key frames, and its weights.
"""

from __future__ import annotations

import numpy as np

from ospc.arrays import FloatArray, IntArray
from ospc.errors import NotObservableError
from ospc.estimation.robust import robust_scale
from ospc.photometry.response import Response
from ospc.recording.frame import Frame
from ospc.research.method import Estimate, Outcome
from ospc.research.rivals.log_response import LogModel
from ospc.unknown_exposures.tracking import GainRobustTracker, TrackObservations

KEY_FRAMES_APART = 100
"""Frames from one key frame to the next."""

_ROUNDS, _HUBER = 10, 1.345
"""Turns of reweighting, and Huber's constant, 95 % efficient for normal residuals."""

_SMOOTHNESS = 0.02
"""Weight of the difference of successive cₖ over the mean weight of the observations of a key frame."""

_BINS = 16
"""Grey levels are balanced in so many bins."""

_FEWEST = 200
"""Pairs of observations."""


def mixture_responses(
    tracks: TrackObservations, truth: Response | None = None, apart: int = KEY_FRAMES_APART
) -> tuple[FloatArray, dict[int, float]]:
    """Return c of every key frame, shape (keys, 5), and exposures by frame, up to a factor.

    Raises
    ------
    NotObservableError
        If too few points are seen in successive frames.
    """
    model, greys = LogModel.learned(), np.arange(256)
    order = np.lexsort((tracks.frame, tracks.point))
    point, frame = tracks.point[order], tracks.frame[order]
    grey, weight = 255 * tracks.grey[order], tracks.weight[order]
    follows = (point[1:] == point[:-1]) & (frame[1:] == frame[:-1] + 1)
    first, second = np.flatnonzero(follows), np.flatnonzero(follows) + 1
    if first.size < _FEWEST:
        raise NotObservableError("too few points are seen in successive frames")
    span = tracks.frames[-1] - tracks.frames[0]
    keys = max(2, round(span / apart) + 1)
    # Hat functions: a frame's response is interpolated between the two key frames around it.
    place = (tracks.frames[frame] - tracks.frames[0]) / max(span, 1) * (keys - 1)
    hats = np.maximum(0, 1 - np.abs(place[:, None] - np.arange(keys)))
    curves = np.stack([np.interp(grey, greys, h) for h in model.components], axis=1)
    columns = (hats[:, :, None] * curves[:, None, :]).reshape(len(grey), -1)
    mean = np.interp(grey, greys, model.mean)
    matrix, target = columns[first] - columns[second], mean[second] - mean[first]
    pair = frame[first]
    weights = np.minimum(weight[first], weight[second]) * model.weight(grey[first], grey[second])
    level = np.minimum((grey[first] * _BINS / 256).astype(int), _BINS - 1)
    weights = weights / np.maximum(np.bincount(level, minlength=_BINS), 1)[level]
    weights = weights * first.size / weights.sum()
    robust = np.ones(first.size)
    smooth = np.kron(np.diff(np.eye(keys), axis=0), np.eye(len(model.components)))
    found = np.zeros(columns.shape[1])
    for _ in range(_ROUNDS):
        total = weights * robust
        # K of every two frames is eliminated by subtracting the means of their rows.
        inner = matrix - _means(matrix, pair, total)[pair]
        rest = target - _means(target[:, None], pair, total)[pair, 0]
        normal = (inner * total[:, None]).T @ inner
        normal += _SMOOTHNESS * float(np.trace(normal)) / len(normal) * smooth.T @ smooth
        found = model.solved(normal, inner.T @ (total * rest), truth)
        residual = inner @ found - rest
        robust = np.minimum(1, _HUBER * (robust_scale(residual) + 1e-9) / np.maximum(np.abs(residual), 1e-12))
    log_ratio = _means((matrix @ found - target)[:, None], pair, weights * robust)[:, 0]
    log_e = -np.append(0.0, np.cumsum(log_ratio))[: tracks.frames.size]
    exposures = dict(zip(tracks.frames.tolist(), np.exp(log_e).tolist(), strict=False))
    return found.reshape(keys, -1), exposures


def _means(values: FloatArray, group: IntArray, weight: FloatArray) -> FloatArray:
    """Return weighted means of rows by group, shape (groups, columns)."""
    count = int(group.max()) + 1
    total = np.maximum(np.bincount(group, weights=weight, minlength=count), 1e-12)
    sums = [np.bincount(group, weights=weight * column, minlength=count) / total for column in values.T]
    return np.asarray(np.stack(sums, axis=1))


class Grundmann:
    """The method, with one point of the true response and without; the result is the mixture halfway."""

    def __init__(self, truth: Response | None) -> None:
        self._truth = truth
        self._tracker = GainRobustTracker(every=1)

    def push(self, frame: Frame) -> None:
        """Take the next frame."""
        self._tracker.push(frame)

    def found(self) -> dict[str, Outcome]:
        """Return the variants that are possible."""
        tracks, model = self._tracker.observations(), LogModel.learned()
        outcomes: dict[str, Outcome] = {}
        for name, truth in (("with", self._truth), ("without", None)):
            if name == "without" or truth is not None:
                coefficients, exposures = mixture_responses(tracks, truth)
                response = model.response(coefficients.mean(axis=0), "grundmann")
                outcomes[f"grundmann-{name}"] = Estimate(response, exposures=exposures)
        return outcomes
