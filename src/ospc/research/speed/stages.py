"""Clocks in the steps of the methods, for as long as a measurement lasts."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from functools import wraps
from importlib import import_module
from types import TracebackType
from typing import Any

_STEPS = (
    ("decoding", "ospc.research.speed.measuring", "", "decode_grey"),
    ("preparing", "ospc.correspondence.preprocessing", "Preprocessor", "__call__"),
    ("noise", "ospc.correspondence.noise_estimation", "NoiseEstimator", "observe"),
    ("registering", "ospc.correspondence.registration", "DenseRegistration", "__call__"),
    ("sampling", "ospc.correspondence.flat_sampling", "FlatSampler", "__call__"),
    ("features", "ospc.methods.paper", "FeatureMatcher", "features"),
    ("matching", "ospc.methods.paper", "FeatureMatcher", "correspondences"),
    ("updating", "ospc.methods.maximum_likelihood", "MaximumLikelihoodMethod", "_refine"),
    ("fitting", "ospc.methods.maximum_likelihood", "MaximumLikelihoodMethod", "_new_inputs"),
)
"""The stages: name, module, class or "" for a function of the module, and function."""

OTHER = "other"
"""Name of the time that no stage accounts for."""


class Stages:
    """A context that measures time by stage, in the thread that entered it only."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._thread = threading.get_ident()
        self._before: list[tuple[Any, str, Any]] = []

    def __enter__(self) -> Stages:
        """Start the clocks."""
        for stage, module, owner, name in _STEPS:
            home = import_module(module)
            place: Any = getattr(home, owner) if owner else home
            step = getattr(place, name)
            self._before.append((place, name, step))
            setattr(place, name, self._clocked(stage, step))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Remove the clocks."""
        for place, name, step in self._before:
            setattr(place, name, step)
        self._before.clear()

    def shares(self, total_s: float) -> dict[str, float]:
        """Return seconds by stage, and what is left of a total."""
        rest = max(0.0, total_s - sum(self.seconds.values()))
        return {**{stage: s for stage, s in self.seconds.items() if s > 0}, OTHER: rest}

    def _clocked(self, stage: str, step: Callable[..., Any]) -> Callable[..., Any]:
        @wraps(step)
        def clocked(*args: Any, **named: Any) -> Any:
            if threading.get_ident() != self._thread:
                return step(*args, **named)
            begun = time.perf_counter()
            try:
                return step(*args, **named)
            finally:
                self.seconds[stage] = self.seconds.get(stage, 0.0) + time.perf_counter() - begun

        return clocked
