"""The parts of the default method with its settings, some of which a test may change."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from ospc.correspondence.flat_sampling import FlatSampler
from ospc.correspondence.keyframe_selection import KeyframeSelector
from ospc.correspondence.preprocessing import Preprocessor
from ospc.settings import DefaultSettings

_SETTINGS = DefaultSettings()


def preprocessor(**changes: Any) -> Preprocessor:
    """Return the preprocessor of the default method."""
    return replace(_SETTINGS.preprocessor(), **changes)


def flat_sampler(**changes: Any) -> FlatSampler:
    """Return the sampler of flat points of the default method."""
    return FlatSampler(replace(_SETTINGS, **changes))


def keyframe_selector(capacity: int = _SETTINGS.keyframes, **changes: Any) -> KeyframeSelector:
    """Return the selector of keyframes of the default method."""
    return KeyframeSelector(**{"capacity": capacity, "max_log_ratio": _SETTINGS.max_log_ratio, **changes})
