"""The cameras of a batch: the recordings of each, merged."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path

from ospc.batch.store import Store
from ospc.batch.table import Row
from ospc.errors import OspcError
from ospc.output import OutputFolder
from ospc.photometry.calibration import Calibration
from ospc.pooling.agreement import Difference
from ospc.pooling.pool import Pool
from ospc.pooling.pooled_calibration import merge
from ospc.state.container import STATE_NAME

_UNSAFE = re.compile(r"[^A-Za-z0-9._-]+")
"""Characters that folder names do not get: some file system or shell gives them a meaning."""

_LONGEST = 60
"""Most characters of a folder name, without the hash: file systems allow 255 bytes for it and what is added."""


@dataclass(frozen=True)
class Camera:
    """One camera of the manifest, and the calibration from all its recordings but those that failed.

    ``folder`` is relative to the batch's; empty where there is no calibration. ``differing`` are recordings that
    contradict the others. ``error`` says why there is no calibration, or what could not be written.
    """

    name: str
    folder: str = ""
    recordings: int = 0
    failed: int = 0
    calibration: Calibration | None = None
    differing: tuple[Difference, ...] = ()
    error: str = ""

    @property
    def is_good(self) -> bool:
        """Whether response and vignette are known, and no recording failed or contradicts the others."""
        return self.calibration is not None and self.calibration.complete and not (self.failed or self.differing)


def merged_cameras(
    rows: Sequence[Row], store: Store, folder: Path, progress: Callable[[int, int], None]
) -> tuple[list[Camera], list[Row]]:
    """Merge the results of each camera into its folder.

    Returns the cameras in the order of the rows, and the rows with ``differs`` filled in; ``progress`` is called
    with the number of cameras done and of all.
    """
    by_name: dict[str, list[Row]] = {}
    for row in rows:
        by_name.setdefault(row.camera, []).append(row)
    cameras, differs = [], {}
    for number, (name, own) in enumerate(by_name.items()):
        camera = _merged(name, own, store, folder)
        cameras.append(camera)
        differs.update({(name, difference.name): difference.text for difference in camera.differing})
        progress(number + 1, len(by_name))
    return cameras, [
        replace(row, differs=differs.get((row.camera, row.recording), "")) if row.status == "done" else row
        for row in rows
    ]


def folder_name(camera: str) -> str:
    """Return a name for a camera's folder: its own if that is safe, else its safe characters and a hash."""
    safe = _UNSAFE.sub("_", camera).strip("._")[:_LONGEST]
    return (
        camera
        if safe == camera
        else f"{safe or 'camera'}-{sha256(camera.encode('utf-8', 'surrogatepass')).hexdigest()[:8]}"
    )


def _merged(name: str, rows: Sequence[Row], store: Store, folder: Path) -> Camera:
    done = [row for row in rows if row.status == "done"]
    camera = Camera(name, recordings=len(rows), failed=sum(row.status == "failed" for row in rows))
    try:
        found = [(row, store.get(row.key).summary) for row in done]
        # Recordings in different folders may have the same name; their paths are unique.
        pool = Pool.of(replace(summary, name=row.recording) for row, summary in found if summary is not None)
        if not len(pool):
            return replace(
                camera,
                error="nothing could be learned from its recordings" if done else "no recording was calibrated",
            )
        merged = merge(pool)
        place = OutputFolder.at(folder / "cameras" / folder_name(name), force=True)
        calibration = replace(merged.calibration, source=merged.calibration.source | {"name": name})
        written = place.write(calibration) + place.report(calibration)
        pool.save(place.path / STATE_NAME)
    except OspcError as error:
        return replace(camera, error=str(error))
    return replace(
        camera,
        folder=place.path.relative_to(folder).as_posix(),
        calibration=merged.calibration,
        differing=tuple(merged.agreement.differing.values()),
        error="; ".join(written.problems),
    )
