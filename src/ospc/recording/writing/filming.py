"""Record a live camera into a folder in the layout of the TUM monocular dataset."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from ospc.errors import RecordingError, SettingError, os_error_as
from ospc.formats.dso import write_times
from ospc.recording.frame import Frame
from ospc.recording.writing.images import NumberedImages, encode

_MOST_FRAMES = 1_000_000
"""Most frames of one recording: nine hours at 30 per second."""


@dataclass(frozen=True)
class Filmed:
    """The folder, its number of images, and the shortest and longest exposure.

    ``repeated`` frames were left out because their time stamp was not later than that of the previous one.
    """

    path: Path
    frames: int
    repeated: int
    exposure_range_ms: tuple[float, float]


def film(
    frames: Iterable[Frame],
    out: str | Path,
    *,
    most: int = _MOST_FRAMES,
    stop: Callable[[], bool] = lambda: False,
    progress: Callable[[int, int], None] = lambda _done, _most: None,
) -> Filmed:
    """Write frames as they arrive; however it ends, what was written until then is a complete recording.

    The folder ``out`` is new or empty. Writing stops after ``most`` frames, or when ``stop``, called after every
    frame, returns True. ``progress`` is called with the number of frames written and ``most``.

    Raises
    ------
    SettingError
        If the folder is not empty or cannot be written to.
    RecordingError
        If no frame arrived; whatever the frames raise is passed on, and those before are kept.
    """
    place = Path(out)
    if place.exists() and not (place.is_dir() and not any(place.iterdir())):
        raise SettingError(f"{place}: is not an empty folder; choose another")
    writing = os_error_as(SettingError, f"{place}: cannot be written", "choose another folder")
    stamps_s: list[float] = []
    exposures_ms: list[float] = []
    repeated = 0
    try:
        with writing, NumberedImages(place, min(most, _MOST_FRAMES), archive=False) as images:
            for frame in frames:
                if stamps_s and round(frame.stamp_s, 9) <= round(stamps_s[-1], 9):
                    repeated += 1
                else:
                    images.write(len(stamps_s), encode(frame, "png"))
                    stamps_s.append(frame.stamp_s)
                    exposures_ms.append(frame.exposure_ms)
                    progress(len(stamps_s), most)
                if stop() or len(stamps_s) >= most:
                    break
    finally:
        if stamps_s:
            write_times(place / "times.txt", range(len(stamps_s)), stamps_s, exposures_ms)
    if not stamps_s:
        raise RecordingError(f"{place}: the camera delivered no frames; check that it is running")
    return Filmed(place, len(stamps_s), repeated, (min(exposures_ms), max(exposures_ms)))
