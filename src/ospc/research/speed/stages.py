"""Clocks in the steps of the methods, for as long as a measurement lasts."""

from __future__ import annotations

import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import wraps
from importlib import import_module
from typing import Any

_STEPS = (
    ("decoding", "ospc.research.speed.reel", "", "decode_grey"),
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


@contextmanager
def clocks() -> Iterator[dict[str, float]]:
    """Give seconds by stage, which are measured in this thread only, until the context ends."""
    seconds: dict[str, float] = defaultdict(float)
    with ExitStack() as stack:
        for stage, module, owner, name in _STEPS:
            home = import_module(module)
            place: Any = getattr(home, owner) if owner else home
            step = getattr(place, name)
            stack.callback(setattr, place, name, step)
            setattr(place, name, _clocked(step, stage, seconds, threading.get_ident()))
        yield seconds


def with_rest(seconds: dict[str, float], total_s: float) -> dict[str, float]:
    """Return seconds by stage, and what is left of a total."""
    return {**seconds, OTHER: max(0.0, total_s - sum(seconds.values()))}


def _clocked(step: Callable[..., Any], stage: str, seconds: dict[str, float], thread: int) -> Callable[..., Any]:
    @wraps(step)
    def clocked(*args: Any, **named: Any) -> Any:
        if threading.get_ident() != thread:
            return step(*args, **named)
        begun = time.perf_counter()
        try:
            return step(*args, **named)
        finally:
            seconds[stage] += time.perf_counter() - begun

    return clocked
