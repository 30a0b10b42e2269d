"""Grundmann, McClanahan, Kang and Essa, "Post-processing approach for radiometric self-calibration of video", 2013.

The response of a camera that adapts its tone curve differs in every frame: it is a mixture of the responses at
keyframes, with weights w that vary over time. For a point with grey levels M and M' in frames t and t',

    Σ wₖ(t) ln gₖ(M) − Σ wₖ(t') ln gₖ(M') = ln e(t) − ln e(t'),    ln gₖ = g₀ + Σ cₖᵢ hᵢ

is linear in all cₖ and ln e. Each frame is compared with six earlier ones, three frames apart. Keyframes, compared
frames, and the weights of grey levels and of both priors (that successive cₖ are similar and all are near the mean)
are those of the first author's program (irradiance_estimation, 2010). Differences: five components instead of seven,
w is linear, and residuals r have the weights 1/|r| of the L1 norm, which the program leaves out. One point of the
response fixes the exponent; without it, the mean curve does. There is no vignette.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from ospc.arrays import FloatArray, IntArray
from ospc.errors import NotObservableError
from ospc.photometry.response import Response
from ospc.recording.frame import Frame
from ospc.research.method import Estimate, Outcome, with_and_without
from ospc.research.rivals.log_response import log_model
from ospc.unknown_exposures.tracking import GainRobustTracker, TrackObservations

KEY_FRAMES_APART = 15
"""Frames from one keyframe to the next."""

_EARLIER = 1 + 3 * np.arange(6)
"""Distances of a frame to the earlier frames it is compared with."""

_GREY_SPREAD = 600 / 1024
"""Width of the Gaussian weight of grey levels about ½."""

_ADJACENT, _PRIOR = (10 * 0.01) ** 2, 10 * 0.05
"""Weights of squared differences of successive cₖ and of squared cₖ, in units of the mean observation weight."""

_ROUNDS, _LEAST_RESIDUAL = 5, 1e-3
"""Rounds of reweighting, and residual of ln g below which weights grow no further."""

_MOST_PAIRS, _FEWEST_PAIRS = 100_000, 200
"""Most pairs of observations used, spread evenly, and fewest needed."""


def mixture_responses(
    tracks: TrackObservations, truth: Response | None = None, apart: int = KEY_FRAMES_APART
) -> tuple[FloatArray, dict[int, float]]:
    """Return c of every keyframe, shape (keys, 5), and exposures by frame, up to a factor."""
    model, greys = log_model(), np.arange(256)
    grey = 255 * tracks.grey
    first, second = _pairs(tracks)
    span = tracks.frames[-1] - tracks.frames[0]
    keys = max(2, round(span / apart) + 1)
    # A frame's response is interpolated linearly between the two keyframes around it.
    place = (tracks.frames[tracks.frame] - tracks.frames[0]) / max(span, 1) * (keys - 1)
    left = np.minimum(place.astype(np.int64), keys - 2)
    curves = np.stack([np.interp(grey, greys, h) for h in model.components], axis=1)
    count, frames = len(model.components), tracks.frames.size
    mean = np.interp(grey, greys, model.mean)

    def terms(at: IntArray) -> csr_array:
        """Return the derivatives of ln g(M) − ln e with respect to all unknowns."""
        share = (place - left)[at]
        values = np.hstack([(1 - share)[:, None] * curves[at], share[:, None] * curves[at], -np.ones((at.size, 1))])
        columns = np.hstack([left[at, None] * count + np.arange(2 * count), keys * count + tracks.frame[at, None]])
        rows = np.repeat(np.arange(at.size), values.shape[1])
        return csr_array((values.ravel(), (rows, columns.ravel())), shape=(at.size, keys * count + frames))

    matrix, target = terms(first) - terms(second), mean[second] - mean[first]
    weights = np.exp(-(((grey[second] / 255 - 0.5) / _GREY_SPREAD) ** 2))
    pull = np.zeros((keys * count + frames,) * 2)
    adjacent = np.kron(np.diff(np.eye(keys), axis=0), np.eye(count))
    pull[: keys * count, : keys * count] = _ADJACENT * adjacent.T @ adjacent + _PRIOR * np.eye(keys * count)
    # The common factor of all exposures is unobservable.
    pull[keys * count :, keys * count :] = 1 / frames
    robust = np.ones(first.size)
    for _ in range(_ROUNDS):
        total = weights * robust
        normal = (matrix.T @ (matrix * total[:, None])).toarray() + total.mean() * pull
        found = model.solved(normal, matrix.T @ (total * target), truth, keys)
        robust = 1 / np.maximum(np.abs(matrix @ found - target), _LEAST_RESIDUAL)
    exposures = dict(zip(tracks.frames.tolist(), np.exp(found[keys * count :]).tolist(), strict=True))
    return found[: keys * count].reshape(keys, count), exposures


def _pairs(tracks: TrackObservations) -> tuple[IntArray, IntArray]:
    """Return observations of the same points in two frames; the first ones are earlier."""
    order = np.lexsort((tracks.frame, tracks.point))
    index = tracks.frames[tracks.frame[order]]
    far = int(tracks.frames.max(initial=0)) + int(_EARLIER.max()) + 1
    # Ascending, because the observations are sorted.
    key = tracks.point[order] * far + index
    first, second = [], []
    for earlier in _EARLIER:
        place = np.minimum(np.searchsorted(key, key - earlier), max(key.size - 1, 0))
        there = (key[place] == key - earlier) & (index >= earlier) if key.size else np.zeros(0, dtype=bool)
        first.append(order[place[there]])
        second.append(order[there])
    one, two = np.concatenate(first), np.concatenate(second)
    if one.size < _FEWEST_PAIRS:
        raise NotObservableError("too few points are seen in several frames")
    kept = np.linspace(0, one.size - 1, min(one.size, _MOST_PAIRS)).astype(np.int64)
    return one[kept], two[kept]


class Grundmann:
    """The method, with and without one point of the true response; the result is the mean over keyframes."""

    def __init__(self, truth: Response | None) -> None:
        self._truth = truth
        self._tracker = GainRobustTracker(every=1)

    def push(self, frame: Frame) -> None:
        """Take the next frame."""
        self._tracker.push(frame)

    def found(self) -> dict[str, Outcome]:
        """Return the possible variants."""
        tracks = self._tracker.observations()

        def estimate(known: Response | None) -> Estimate:
            coefficients, exposures = mixture_responses(tracks, known)
            return Estimate(log_model().response(coefficients.mean(axis=0), "grundmann"), exposures=exposures)

        return with_and_without("grundmann", self._truth, estimate)
