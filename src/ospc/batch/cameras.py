"""The cameras of a batch: merge the recordings of each camera, and render an overview page, failures first."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path

from ospc.batch.store import Row, Store
from ospc.errors import OspcError, counted
from ospc.photometry.calibration import Calibration
from ospc.pooling.agreement import Difference
from ospc.pooling.pool import largest_alike, merge
from ospc.recording.kinds import safe_name
from ospc.report.html import Html, document, join, tag
from ospc.report.output_folder import OutputFolder
from ospc.state.container import STATE_NAME

_LONGEST = 60
"""Longest folder name in characters, without the hash: file systems allow 255 bytes in total."""


@dataclass(frozen=True)
class Camera:
    """One camera of the manifest, with the calibration merged from its successful recordings.

    ``folder`` is relative to the batch folder, and empty if there is no calibration. ``differing`` are recordings
    that contradict the others. ``error`` says why there is no calibration, or what could not be written.
    """

    name: str
    folder: str = ""
    recordings: int = 0
    failed: int = 0
    calibration: Calibration | None = None
    differing: tuple[Difference, ...] = ()
    error: str = ""

    @property
    def is_complete(self) -> bool:
        """Whether response and vignette are identifiable."""
        return self.calibration is not None and self.calibration.complete

    @property
    def is_good(self) -> bool:
        """Whether response and vignette are identifiable, and no recording failed or contradicts the others."""
        return self.is_complete and not (self.failed or self.differing)


def merged_cameras(
    rows: Sequence[Row], store: Store, folder: Path, progress: Callable[[int, int], None]
) -> tuple[list[Camera], list[Row]]:
    """Merge the results of each camera into its folder.

    Returns the cameras in the order of the rows, and the rows with ``differs`` filled in. ``progress`` is called with
    the number of cameras done and the total.
    """
    by_name: dict[str, list[Row]] = {}
    for row in rows:
        by_name.setdefault(row.camera, []).append(row)
    cameras = []
    for name, own in by_name.items():
        cameras.append(_merged(name, own, store, folder))
        progress(len(cameras), len(by_name))
    differs = {(camera.name, found.name): found.text for camera in cameras for found in camera.differing}
    return cameras, [
        replace(row, differs=differs.get((row.camera, row.recording), "")) if row.status == "done" else row
        for row in rows
    ]


def folder_name(camera: str) -> str:
    """Return a folder name for a camera: its name if that is safe, else its safe characters and a hash."""
    safe = safe_name(camera, _LONGEST)
    digest = sha256(camera.encode("utf-8", "surrogatepass")).hexdigest()
    return camera if safe == camera else f"{safe}-{digest[:8]}"


def _merged(name: str, rows: Sequence[Row], store: Store, folder: Path) -> Camera:
    done = [row for row in rows if row.status == "done"]
    camera = Camera(name, recordings=len(rows), failed=sum(row.status == "failed" for row in rows))
    place = OutputFolder(folder / "cameras" / folder_name(name))
    try:
        found = [(row, store.get(row.key).summary) for row in done]
        # Recordings in different folders may have the same name; their paths are unique.
        named = [replace(summary, name=row.recording) for row, summary in found if summary is not None]
        pool, others = largest_alike(named)
        if not len(pool):
            if len(done) == len(rows):  # otherwise, the earlier result may still be right
                place.remove()
            why = "nothing could be learned from its recordings" if done else "no recording could be processed"
            return replace(camera, error=why)
        merged = merge(pool)
        place = OutputFolder.at(place.path, force=True)
        calibration = replace(merged.calibration, source=merged.calibration.source | {"name": name})
        written = place.write(calibration) + place.report(place.findings(calibration))
        pool.save(place.path / STATE_NAME)
    except OspcError as error:
        return replace(camera, error=str(error))
    return replace(
        camera,
        folder=place.path.relative_to(folder).as_posix(),
        calibration=merged.calibration,
        differing=(*others, *merged.agreement.differing.values()),
        error="; ".join(written.problems),
    )


_MOST_CAMERAS, _MOST_FAILURES = 2000, 1000
"""Most entries shown, to keep the page small enough for a browser."""


def page(cameras: Sequence[Camera], rows: Sequence[Row]) -> str:
    """Return the overview page as HTML, without scripts or external resources."""
    done = sum(row.status == "done" for row in rows)
    title = f"{done} of {counted(len(rows), 'recording')} of {counted(len(cameras), 'camera')} processed"
    failures = [row for row in rows if row.status == "failed"]
    failed = [(r.recording, r.camera, f"{r.error} (tried {counted(r.attempts, 'time')})") for r in failures]
    left = sum(row.status == "not done" for row in rows)
    differing = [(d.name, camera.name, d.text) for camera in cameras for d in camera.differing]
    return document(
        title,
        tag("h1", title),
        _table("Failed", ("recording", "camera", "why"), failed),
        tag("p", f"{counted(left, 'recording')} not done yet: run the same command again to continue.")
        if left
        else "",
        _table("Contradicting other recordings of their camera", ("recording", "camera", "difference"), differing),
        _cameras(cameras),
    )


def _table(heading: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> Html:
    if not rows:
        return Html()
    head = tag("thead", tag("tr", *(tag("th", column, scope="col") for column in columns)))
    body = (join(tag("tr", *(tag("td", cell) for cell in row)), "\n") for row in rows[:_MOST_FAILURES])
    more = tag("p", f"… and {len(rows) - _MOST_FAILURES} more in batch.csv.") if len(rows) > _MOST_FAILURES else ""
    return tag("section", tag("h2", f"{heading}: {len(rows)}"), tag("table", head, tag("tbody", *body)), more)


def _cameras(cameras: Iterable[Camera]) -> Html:
    # Cameras that need attention come first; otherwise the manifest's order is kept.
    ordered = sorted(cameras, key=lambda camera: (camera.calibration is not None, camera.is_good))
    items = (join(_item(camera), "\n") for camera in ordered[:_MOST_CAMERAS])
    left = len(ordered) - _MOST_CAMERAS
    more = tag("p", f"… and {left} more in the folder cameras.") if left > 0 else ""
    return tag("section", tag("h2", "Cameras"), tag("div", *items, class_="parts"), more)


def _item(camera: Camera) -> Html:
    link = f"{camera.folder}/report.html"
    differing = f"contradicting the others: {len(camera.differing)}" if camera.differing else ""
    attention = [camera.error, differing]
    return tag(
        "div",
        tag("h3", tag("a", camera.name, href=link) if camera.folder else camera.name),
        tag("p", f"{camera.recordings - camera.failed} of {counted(camera.recordings, 'recording')}"),
        *(tag("p", tag("strong", text)) for text in attention if text),
        Html() if camera.calibration is None else _calibration(camera.calibration),
        class_=f"verdict {'good' if camera.is_good else 'bad'}",
    )


def _calibration(calibration: Calibration) -> Html:
    verdicts = [
        tag("p", f"{name}: {verdict.state}")
        if verdict.state == "identifiable"
        else tag("p", f"{name}: ", tag("strong", verdict.state), f", {verdict.reason}")
        for name, verdict in calibration.verdicts.items()
    ]
    return join(tag("p", Html(calibration.curves_as_svg())), *verdicts)
