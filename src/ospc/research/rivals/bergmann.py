"""Joint estimation as published: online from a window of frames, or from all frames at once.

Bergmann, Wang and Cremers, "Online photometric calibration of auto exposure video for realtime visual odometry and
SLAM", 2018. The estimation itself, O = f(eᵢ V(xᵢᵖ) Lᵖ) with f, V, e and L free, is
:mod:`ospc.unknown_exposures.joint_estimation`. Its result is known up to g → g^γ, V → V^γ, e → e^γ. The publication
fixes γ by one point of the true response, g(½)^γ = G(½) ("WGT"); without it, γ stays near where the optimisation
started ("WOGT").
"""

from __future__ import annotations

from ospc.photometry.response import Response
from ospc.recording.frame import Frame
from ospc.research.method import Estimate, Outcome
from ospc.unknown_exposures.joint_estimation import JointEstimate, estimate_jointly
from ospc.unknown_exposures.tracking import GainRobustTracker

WINDOW, EVERY = 200, 50
"""Frames that an online estimate uses, and frames between estimates."""
_ITERATIONS_ONLINE, _ITERATIONS = 20, 60
"""Most alternations; online estimates start at the previous one and need fewer."""


class Bergmann:
    """Joint estimation without exposures, with and without one point of the true response.

    If ``online``, it estimates every ``every`` frames from the latest ``window`` frames; otherwise once from all
    frames at the end.
    """

    def __init__(self, truth: Response | None, *, online: bool, window: int = WINDOW, every: int = EVERY) -> None:
        self._truth, self._online = truth, online
        self._window, self._every = window, every
        self._tracker = GainRobustTracker()
        self._latest: JointEstimate | None = None
        self._done = 0

    def push(self, frame: Frame) -> None:
        """Take the next frame."""
        self._tracker.push(frame)
        self._done = frame.index + 1
        if self._online and self._done % self._every == 0 and self._done >= self._window // 2:
            self._latest = self._estimated(_ITERATIONS_ONLINE)

    def estimate(self) -> JointEstimate:
        """Return the latest online estimate, or one from all frames, without a point of the truth."""
        return self._latest or self._estimated(_ITERATIONS)

    def found(self) -> dict[str, Outcome]:
        """Return the possible variants, as ``-wgt`` and ``-wogt``."""
        name = "joint-online" if self._online else "joint-batch"
        free = self.estimate()
        outcomes = {} if self._truth is None else {f"{name}-wgt": _as_estimate(free.aligned_to(self._truth))}
        return {**outcomes, f"{name}-wogt": _as_estimate(free)}

    def _estimated(self, iterations: int) -> JointEstimate:
        tracks = self._tracker.observations()
        if self._online:
            tracks = tracks.since(self._done - self._window)
        return estimate_jointly(tracks, start=self._latest, iterations=iterations)


def _as_estimate(found: JointEstimate) -> Estimate:
    exposures = dict(zip(found.frames.tolist(), found.exposures.tolist(), strict=True))
    return Estimate(found.response, found.vignette, exposures=exposures)
