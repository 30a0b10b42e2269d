"""Show a calibrator films of cameras that change and of cameras that do not, and evaluate the changes it reports.

    python benchmarks/camera_changes.py --results changes --hours 1 --rate 20 50
    python benchmarks/camera_changes.py --results changes --switch --films 4

Without --switch no camera changes, and every reported change is false. With --switch each film is run once for each
change of CHANGES, which happens after two thirds of the film, and the delay is reported.

The clock is virtual: stamps follow the given rate, frames come as fast as the calibrator takes them, and only those
it needs are rendered. Each film has its own scene, motion, light and noise; see long_film.py. The result of each film
is stored in the folder --results when it ends, and an interrupted run continues with the next.
"""

from __future__ import annotations

import argparse
import statistics
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import cv2

from long_film import CAMERAS, Camera, LongFilm, Switch
from ospc import OnlineCalibrator
from results import Row, errors, measured, table_of

SWITCH_AFTER_S, WATCHED_S = 60.0, 30.0
"""Time before a change of the camera, and after it."""

_SAME_COLUMNS = (
    "camera", "seed", "rate", "hours", "false changes", "processed", "processor s", "V", "shape", "kappa", "called",
)  # fmt: skip
_SWITCH_COLUMNS = ("camera", "seed", "rate", "change", "false changes", "delay s", "off by s", "called")

CHANGES = ("corner -20 %", "another response", "similar response", "exposures 2 late")
"""Changes of the camera."""

RESPONSES = {
    "another response": {"srgb": "filmic", "filmic": "srgb", "linear": "gamma2.2", "gamma2.2": "linear"},
    "similar response": {"srgb": "gamma2.2", "filmic": "log", "linear": "tum_narrow", "gamma2.2": "srgb"},
}
"""Replacements for the cameras' responses; a similar one is like that of another picture profile."""


def _switch(change: str, camera: Camera) -> Switch:
    if change in RESPONSES:
        camera = replace(camera, response=RESPONSES[change][camera.response])
    if change.startswith("corner"):
        first, second, third = camera.vignette
        camera = replace(camera, vignette=(first - 0.2 * (1 + sum(camera.vignette)), second, third))
    return Switch(SWITCH_AFTER_S, camera, 2 if change.endswith("late") else 0)


def shown(film: LongFilm) -> tuple[OnlineCalibrator, list[tuple[float, str]], float]:
    """Show a film; return the calibrator, when each change was reported and as what, and the processor seconds."""
    calibrator = OnlineCalibrator()
    reported: list[tuple[float, str]] = []
    begun_s = time.process_time()
    for frame in film:
        calibrator.push(frame)
        if len(calibrator.epochs) - 1 > len(reported):
            change = calibrator.epochs[-2].change
            assert change is not None
            reported.append((frame.stamp_s, change.text))
    return calibrator, reported, time.process_time() - begun_s


def unchanged(camera: str, hours: float, rate: float, seed: int) -> Row:
    """Show a film of a camera that stays the same, so that all reported changes are false."""
    film = LongFilm(CAMERAS[camera], hours, rate, seed)
    calibrator, reported, spent_s = shown(film)
    about = {"camera": camera, "seed": seed, "rate": rate, "hours": hours}
    return about | {
        "false changes": len(reported),
        "called": "; ".join(text for _, text in reported[:3]),
        "processed": film.rendered,
        "processor s": spent_s,
        **errors(calibrator.calibration(), film),
    }


def switched(camera: str, change: str, rate: float, seed: int) -> Row:
    hours = (SWITCH_AFTER_S + WATCHED_S) / 3600
    film = LongFilm(CAMERAS[camera], hours, rate, seed, _switch(change, CAMERAS[camera]))
    calibrator, reported, _ = shown(film)
    late = [(stamp_s, text) for stamp_s, text in reported if stamp_s >= SWITCH_AFTER_S]
    first_frames = [epoch.first_frame for epoch in calibrator.epochs[1:]]
    about = {"camera": camera, "seed": seed, "rate": rate, "change": change}
    return about | {
        "false changes": len(reported) - len(late[:1]),
        "delay s": late[0][0] - SWITCH_AFTER_S if late else None,
        "off by s": first_frames[-len(late)] / rate - SWITCH_AFTER_S if late else None,
        "called": "; ".join(text for _, text in reported[:3]),
    }


def summary(rows: list[Row]) -> str:
    false = sum(row["false changes"] for row in rows)
    if "change" not in rows[0]:
        hours = sum(row["hours"] for row in rows)
        return f"{false} changes reported in {hours:.1f} h of film without any: {false / hours:.2f} per hour"
    lines = []
    for change in CHANGES:
        delays = [row["delay s"] for row in rows if row["change"] == change]
        found = [delay for delay in delays if delay is not None]
        delay = f", after {statistics.median(found):.1f} s (median), {max(found):.1f} s at most" if found else ""
        lines.append(f"{change}: {len(found)} of {len(delays)} found{delay}")
    return "\n".join([*lines, f"false changes: {false}"])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--results", type=Path, required=True, help="Folder of the results.")
    parser.add_argument("--hours", type=float, default=1.0, help="Length of a film without a change.")
    parser.add_argument("--rate", type=float, nargs="+", default=[20.0, 50.0], help="Frames per second.")
    parser.add_argument("--films", type=int, default=1, help="Number of films of each camera.")
    parser.add_argument("--seed", type=int, default=0, help="Seed of the first film.")
    parser.add_argument("--cameras", nargs="+", choices=CAMERAS, default=list(CAMERAS))
    parser.add_argument("--switch", action="store_true", help="Change the camera in mid-film.")
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    calls: dict[str, partial[Row]] = {}
    for seed in range(arguments.seed, arguments.seed + arguments.films):
        for rate in arguments.rate:
            for camera in arguments.cameras:
                film = f"{camera} {seed} {rate:g} Hz"
                if arguments.switch:
                    for change in CHANGES:
                        calls[f"{film} {change}"] = partial(switched, camera, change, rate, seed)
                else:
                    hours = arguments.hours
                    calls[f"{film} {hours:g} h"] = partial(unchanged, camera, hours, rate, seed)
    rows = measured(calls, arguments.results)
    print(table_of("Changes of the camera", rows, _SWITCH_COLUMNS if arguments.switch else _SAME_COLUMNS))
    print(summary(rows))


if __name__ == "__main__":
    main()
