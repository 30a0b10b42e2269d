"""A description that tells one recording from another, stored with every result."""

from __future__ import annotations

from hashlib import sha256
from typing import Any

import numpy as np

from ospc.errors import FrameError, escaped
from ospc.recording.recording import HasStoredBytes, Recording

_SAMPLES = 5
"""Images hashed, evenly spread: enough to tell recordings apart, few enough to cost nothing."""


def identity(recording: Recording) -> dict[str, Any]:
    """Describe a recording so that it can be recognised again, wherever it is moved to.

    The description is JSON-compatible: kind, name of the folder or file, number of frames, size, largest grey value,
    range of the exposures, SHA-256 over stamps and exposures, and SHA-256 over a few images as they are stored.
    """
    exposures_ms = np.asarray(recording.exposures_ms, dtype="<f8")
    stamps_s = np.asarray(recording.stamps_s, dtype="<f8")
    indices = sorted({int(i) for i in np.linspace(0, max(len(recording) - 1, 0), _SAMPLES)})
    return {
        "kind": recording.kind,
        "name": escaped(recording.path.name or recording.path.resolve().name),
        "frames": len(recording),
        "size": list(recording.size),
        "max_grey": recording.max_grey,
        "exposure_range_ms": [float(exposures_ms.min()), float(exposures_ms.max())],
        "frames_sha256": sha256(stamps_s.tobytes() + exposures_ms.tobytes()).hexdigest(),
        "images_sha256": _images_sha256(recording, indices),
        "images_hashed": indices,
    }


def _images_sha256(recording: Recording, indices: list[int]) -> str:
    """Hash a few images; an unreadable one counts as empty."""
    channel = getattr(recording, "channel", None)
    total = sha256(b"" if channel is None else channel.value.encode())
    if isinstance(recording, HasStoredBytes):
        for index in indices:
            try:
                stored = recording.stored_bytes(index)
            except FrameError:
                stored = b""
            total.update(sha256(stored).digest())
        return total.hexdigest()
    wanted = set(indices)
    for frame in recording:
        if frame.index in wanted:
            try:
                pixels = frame.image.tobytes()
            except FrameError:
                pixels = b""
            total.update(sha256(pixels).digest())
    return total.hexdigest()
