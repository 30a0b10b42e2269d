"""The overview of a batch: one page with a small picture of each camera, failures first."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from ospc.batch.cameras import Camera
from ospc.batch.table import Row
from ospc.errors import counted
from ospc.formats.files import write_bytes
from ospc.photometry.calibration import Calibration
from ospc.report.html import Html, document, join, tag

_MOST_CAMERAS, _MOST_FAILURES = 2000, 1000
"""Entries shown: more would make the page too large for a browser."""

_STYLE = """
:root { color-scheme: light dark; --ink: #222; --ground: #fff; --line: #ccc; --bad: #D55E00; --good: #009E73; }
@media (prefers-color-scheme: dark) { :root { --ink: #ddd; --ground: #181818; --line: #555; } }
body { font: 15px/1.45 system-ui, sans-serif; color: var(--ink); background: var(--ground);
  max-width: 72rem; margin: 2rem auto; padding: 0 1rem; }
table { border-collapse: collapse; width: 100%; } th, td { text-align: left; vertical-align: top;
  padding: .25rem .6rem .25rem 0; border-bottom: 1px solid var(--line); overflow-wrap: anywhere; }
ul.cameras { list-style: none; padding: 0; display: grid; gap: 1rem;
  grid-template-columns: repeat(auto-fill, minmax(min(31rem, 100%), 1fr)); }
ul.cameras > li { border: 1px solid var(--line); border-left: .35rem solid var(--good); padding: .6rem .8rem; }
ul.cameras > li.bad { border-left-color: var(--bad); } h3 { margin: 0 0 .3rem; font-size: 1rem; }
p { margin: .3rem 0; } .bad strong { color: var(--bad); }
"""


def write_overview(cameras: Sequence[Camera], rows: Sequence[Row], path: Path) -> Path:
    """Write the page, whole or not at all, and return the path."""
    return write_bytes(path, page(cameras, rows).encode("utf-8", "replace"))


def page(cameras: Sequence[Camera], rows: Sequence[Row]) -> str:
    """Return the page as HTML; it needs neither network nor scripts."""
    done = sum(row.status == "done" for row in rows)
    title = f"{done} of {counted(len(rows), 'recording')} of {counted(len(cameras), 'camera')} calibrated"
    failed = [
        (row.recording, row.camera, f"{row.error} (tried {counted(row.attempts, 'time')})")
        for row in rows
        if row.status == "failed"
    ]
    left = sum(row.status == "not done" for row in rows)
    differing = [(d.name, camera.name, d.text) for camera in cameras for d in camera.differing]
    return document(
        title,
        _STYLE,
        tag("h1", title),
        _table("Failed", ("recording", "camera", "why"), failed),
        tag("p", f"{counted(left, 'recording')} not done yet: run the same command again to go on.") if left else "",
        _table("Contradicting the others of their camera", ("recording", "camera", "in what"), differing),
        _cameras(cameras),
    )


def _table(heading: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> Html:
    if not rows:
        return Html()
    head = tag("thead", tag("tr", *(tag("th", column, scope="col") for column in columns)))
    body = (join(tag("tr", *(tag("td", cell) for cell in row)), "\n") for row in rows[:_MOST_FAILURES])
    more = tag("p", f"… and {len(rows) - _MOST_FAILURES} more: see batch.csv.") if len(rows) > _MOST_FAILURES else ""
    return tag("section", tag("h2", f"{heading}: {len(rows)}"), tag("table", head, tag("tbody", *body)), more)


def _cameras(cameras: Iterable[Camera]) -> Html:
    # Cameras that need attention come first; otherwise the manifest's order is kept.
    ordered = sorted(cameras, key=lambda camera: (camera.calibration is not None, camera.is_good))
    items = (join(_item(camera), "\n") for camera in ordered[:_MOST_CAMERAS])
    left = len(ordered) - _MOST_CAMERAS
    more = tag("p", f"… and {left} more: see the folder cameras.") if left > 0 else ""
    return tag("section", tag("h2", "Cameras"), tag("ul", *items, class_="cameras"), more)


def _item(camera: Camera) -> Html:
    link = f"{camera.folder}/report.html"
    attention = [camera.error, f"{len(camera.differing)} contradict the others" if camera.differing else ""]
    return tag(
        "li",
        tag("h3", tag("a", camera.name, href=link) if camera.folder else camera.name),
        tag("p", f"{camera.recordings - camera.failed} of {counted(camera.recordings, 'recording')}"),
        *(tag("p", tag("strong", text)) for text in attention if text),
        Html() if camera.calibration is None else _calibration(camera.calibration),
        class_="good" if camera.is_good else "bad",
    )


def _calibration(calibration: Calibration) -> Html:
    verdicts = [
        tag("p", f"{name}: {verdict.state}")
        if verdict.state == "identifiable"
        else tag("p", f"{name}: ", tag("strong", verdict.state), f", {verdict.reason}")
        for name, verdict in calibration.verdicts.items()
    ]
    return join(tag("p", Html(calibration.curves_as_svg())), *verdicts)
