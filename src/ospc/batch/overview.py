"""The overview of a batch: one page with a small picture of each camera, failures first."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from html import escape
from pathlib import Path

import numpy as np

from ospc.arrays import FloatArray
from ospc.batch.cameras import Camera
from ospc.batch.table import Row
from ospc.formats.files import write_bytes
from ospc.photometry.calibration import PROFILE_RADII, Calibration
from ospc.photometry.vignette import Vignette

_MOST_CAMERAS, _MOST_FAILURES = 2000, 1000
"""Entries shown: more would make the page too large for a browser."""

_WIDTH, _HEIGHT = 150, 100
"""Size of a picture in CSS pixels."""

_POINTS = 41
"""Points of a drawn response: one every four pixels."""

_POLICY = "default-src 'none'; style-src 'unsafe-inline'"
_STYLE = """
:root { color-scheme: light dark; --ink: #222; --ground: #fff; --line: #ccc; --bad: #D55E00; --good: #009E73; }
@media (prefers-color-scheme: dark) { :root { --ink: #ddd; --ground: #181818; --line: #555; } }
body { font: 15px/1.45 system-ui, sans-serif; color: var(--ink); background: var(--ground);
  max-width: 72rem; margin: 2rem auto; padding: 0 1rem; }
table { border-collapse: collapse; width: 100%; } th, td { text-align: left; vertical-align: top;
  padding: .25rem .6rem .25rem 0; border-bottom: 1px solid var(--line); overflow-wrap: anywhere; }
ul.cameras { list-style: none; padding: 0; display: grid; gap: 1rem;
  grid-template-columns: repeat(auto-fill, minmax(20rem, 1fr)); }
ul.cameras > li { border: 1px solid var(--line); border-left: .35rem solid var(--good); padding: .6rem .8rem; }
ul.cameras > li.bad { border-left-color: var(--bad); } h3 { margin: 0 0 .3rem; font-size: 1rem; }
p { margin: .3rem 0; } .bad strong { color: var(--bad); } svg { margin-right: .6rem; }
svg path { fill: none; stroke-width: 1.6; } .frame { stroke: var(--line); } .g { stroke: #0072B2; }
.v { stroke: #D55E00; } svg text { font-size: 10px; fill: var(--ink); }
"""


def write_overview(cameras: Sequence[Camera], rows: Sequence[Row], path: Path) -> Path:
    """Write the page, whole or not at all, and return the path.

    Raises
    ------
    FormatError
        If it cannot be written.
    """
    return write_bytes(path, page(cameras, rows).encode("utf-8", "replace"))


def page(cameras: Sequence[Camera], rows: Sequence[Row]) -> str:
    """Return the page as HTML; it needs neither network nor scripts."""
    done = sum(row.status == "done" for row in rows)
    title = f"{done} of {len(rows)} recordings of {len(cameras)} cameras calibrated"
    sections = "".join([*_failures(rows), *_differing(cameras), *_cameras(cameras)])
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{_STYLE}</style></head>\n"
        f"<body><main><h1>{escape(title)}</h1>\n{sections}</main></body></html>\n"
    )


def _failures(rows: Sequence[Row]) -> Iterator[str]:
    failed = [row for row in rows if row.status == "failed"]
    if failed:
        shown = [(row.recording, row.camera, f"{row.error} (tried {row.attempts} times)") for row in failed]
        yield _table(f"Failed: {len(failed)}", ("recording", "camera", "why"), shown)
    left = sum(row.status == "not done" for row in rows)
    if left:
        yield f"<p>{left} recordings are not done yet: run the same command again to go on.</p>\n"


def _differing(cameras: Sequence[Camera]) -> Iterator[str]:
    found = [(d.name, camera.name, d.text) for camera in cameras for d in camera.differing]
    if found:
        heading = f"Contradicting the others of their camera: {len(found)}"
        yield _table(heading, ("recording", "camera", "in what"), found)


def _table(heading: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    head = "".join(f'<th scope="col">{escape(column)}</th>' for column in columns)
    body = "".join(
        f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>\n" for row in rows[:_MOST_FAILURES]
    )
    more = f"<p>… and {len(rows) - _MOST_FAILURES} more: see batch.csv.</p>" if len(rows) > _MOST_FAILURES else ""
    return (
        f"<section><h2>{escape(heading)}</h2><table><thead><tr>{head}</tr></thead><tbody>\n{body}</tbody></table>"
        f"{more}</section>\n"
    )


def _cameras(cameras: Sequence[Camera]) -> Iterator[str]:
    # Cameras that need attention come first; otherwise the manifest's order is kept.
    ordered = sorted(cameras, key=lambda camera: (camera.calibration is not None, camera.is_good))
    items = "".join(_item(camera) for camera in ordered[:_MOST_CAMERAS])
    yield f'<section><h2>Cameras</h2><ul class="cameras">\n{items}</ul></section>\n'
    if len(ordered) > _MOST_CAMERAS:
        yield f"<p>… and {len(ordered) - _MOST_CAMERAS} more: see the folder cameras.</p>\n"


def _item(camera: Camera) -> str:
    counted = camera.recordings - camera.failed
    facts = f"{counted} of {camera.recordings} recordings"
    name = escape(camera.name)
    heading = f'<a href="{escape(camera.folder)}/calibration.json">{name}</a>' if camera.folder else name
    body = f"<p>{facts}</p>"
    if camera.error:
        body += f"<p><strong>{escape(camera.error)}</strong></p>"
    if camera.differing:
        body += f"<p><strong>{len(camera.differing)} contradict the others</strong></p>"
    if camera.calibration is not None:
        body += f"<p>{_pictures(camera.calibration)}</p>{_verdicts(camera.calibration)}"
    style = "good" if camera.is_good else "bad"
    return f'<li class="{style}"><h3>{heading}</h3>{body}</li>\n'


def _verdicts(calibration: Calibration) -> str:
    return "".join(
        f"<p>{escape(name)}: {escape(verdict.state)}</p>"
        if verdict.state == "identifiable"
        else f"<p>{escape(name)}: <strong>{escape(verdict.state)}</strong>, {escape(verdict.reason)}</p>"
        for name, verdict in calibration.verdicts.items()
    )


def _pictures(calibration: Calibration) -> str:
    response, vignette = calibration.response, calibration.vignette
    pictures = ""
    if response is not None:
        grey = np.linspace(0, 1, _POINTS)
        pictures += _picture("g(M), irradiance over grey level", "g", grey, response.inverse(grey))
    if vignette is not None:
        pictures += _picture("V(R), vignette from centre to corner", "v", PROFILE_RADII, _profile(vignette))
    return pictures


def _profile(vignette: Vignette) -> FloatArray:
    size = np.array(vignette.size, dtype=np.float64) - 1
    ray = size / 2 + PROFILE_RADII[:, None] * size / 2
    return np.asarray(vignette.at(ray), dtype=np.float64).reshape(-1)


def _picture(title: str, style: str, x: FloatArray, y: FloatArray) -> str:
    points = zip(x * _WIDTH, (1 - np.clip(y, 0, 1.05)) * _HEIGHT, strict=True)
    path = "M" + "L".join(f"{px:.1f} {py:.1f}" for px, py in points)
    return (
        f'<svg role="img" width="{_WIDTH}" height="{_HEIGHT}" viewBox="-1 -1 {_WIDTH + 2} {_HEIGHT + 2}">'
        f"<title>{escape(title)}</title>"
        f'<path class="frame" d="M0 0V{_HEIGHT}H{_WIDTH}"/><path class="{style}" d="{path}"/></svg>'
    )
