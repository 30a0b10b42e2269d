"""Show a calibrator hours of film of cameras that never change, and count the changes it reports nevertheless.

    python benchmarks/false_changes.py --results false_changes.jsonl --hours 10 --rate 20 --cameras webcam wide
    python benchmarks/false_changes.py --results false_changes.jsonl --hours 0.33 --films 3

The clock is virtual: stamps run at the rate given, the frames come as fast as they are taken, and only those that
the calibrator asks for are rendered. Each film has its own scene, motion, light and noise; see long_film.py. The
result of each film is added to the file --results when it ends; a run that was interrupted goes on with the next.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Protocol

import cv2

from long_film import CAMERAS, LongFilm
from ospc import Calibration, Frame, OnlineCalibrator
from ospc.evaluation.metrics import log_ratio_error, response_shape_rmse, vignette_rmse
from result_files import ResultFile, Row, table

_COLUMNS = (
    "camera", "seed", "rate", "hours", "known after s", "changes", "changes per hour", "processed", "1 in",
    "processor s", "V", "shape", "kappa", "calls",
)  # fmt: skip


class Driver(Protocol):
    """What is shown the film."""

    def push(self, frame: Frame) -> None:
        """Take the next frame."""
        ...

    @property
    def changes(self) -> list[str]:
        """What was said of each change, or when it was reported."""
        ...

    @property
    def known(self) -> bool:
        """Whether response and vignette are known."""
        ...

    def calibration(self) -> Calibration:
        """Return what is known at the end."""
        ...


class Online:
    """An online calibrator that looks for changes itself; there is one epoch more than changes."""

    def __init__(self) -> None:
        self._calibrator = OnlineCalibrator()
        self._begun: list[str] = []
        self._checked_at = 0

    def push(self, frame: Frame) -> None:
        self._calibrator.push(frame)
        if len(self._calibrator.epochs) - 1 > len(self._begun):
            self._begun.append(f"frame {frame.index}: {self._calibrator.epochs[-1]}")

    @property
    def changes(self) -> list[str]:
        return self._begun

    @property
    def known(self) -> bool:
        # A fit costs time: it is asked for rarely, and only until all is known.
        count = self._calibrator.status.frames
        if count < 1.25 * self._checked_at + 50:
            return False
        self._checked_at = count
        return self._calibrator.calibration().converged

    def calibration(self) -> Calibration:
        return self._calibrator.calibration()


class Watching:
    """What a live calibrator does in the background, without its thread: it passes over as many frames."""

    def __init__(self) -> None:
        from ospc.live.watch import Watch

        self._watch = Watch()
        self._pause = 0
        self._notes: list[str] = []

    def push(self, frame: Frame) -> None:
        if self._pause > 0:
            self._pause -= 1
            return
        before = self._watch.changes
        self._watch.look(frame)
        self._pause = self._watch.pause
        if self._watch.changes > before:
            self._notes.append(self._watch.notes[-1])

    @property
    def changes(self) -> list[str]:
        return self._notes

    @property
    def known(self) -> bool:
        return self._watch.watching

    def calibration(self) -> Calibration:
        return self._watch.latest or self._watch.estimate()


def driver() -> Driver:
    """Return the calibrator to show the film to."""
    return Online() if hasattr(OnlineCalibrator(), "epochs") else Watching()


def shown(camera: str, hours: float, rate: float, seed: int) -> Row:
    """Show a film and return what was reported."""
    film = LongFilm(CAMERAS[camera], hours, rate, seed)
    watching = driver()
    known_after_s: float | None = None
    begun_s = time.process_time()
    for frame in film:
        watching.push(frame)
        if known_after_s is None and watching.known:
            known_after_s = frame.stamp_s
    spent_s = time.process_time() - begun_s
    found = watching.calibration()
    response, vignette = found.response, found.vignette
    return {
        "camera": camera,
        "seed": seed,
        "rate": rate,
        "hours": hours,
        "known after s": known_after_s,
        "changes": len(watching.changes),
        "changes per hour": len(watching.changes) / hours,
        "calls": watching.changes[:20],
        "processed": film.rendered,
        "1 in": len(film) / max(film.rendered, 1),
        "processor s": spent_s,
        "V": None if vignette is None else vignette_rmse(vignette, film.vignette),
        "shape": None if response is None else response_shape_rmse(response, film.response),
        "kappa": None if response is None else log_ratio_error(response, film.response),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--results", type=Path, required=True, help="JSON-lines file of the results.")
    parser.add_argument("--hours", type=float, default=1.0, help="Length of a film.")
    parser.add_argument("--rate", type=float, default=20.0, help="Frames per second.")
    parser.add_argument("--films", type=int, default=1, help="Number of films of each camera.")
    parser.add_argument("--seed", type=int, default=0, help="Seed of the first film.")
    parser.add_argument("--cameras", nargs="+", choices=CAMERAS, default=list(CAMERAS))
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    results = ResultFile(arguments.results)
    keys = []
    for seed in range(arguments.seed, arguments.seed + arguments.films):
        for camera in arguments.cameras:
            key = f"{camera} {seed} {arguments.rate:g} Hz {arguments.hours:g} h"
            keys.append(key)
            if key not in results:
                results.add(key, shown(camera, arguments.hours, arguments.rate, seed))
                print(key, "done", flush=True)
    rows = results.rows(keys)
    print(table([{**row, "calls": "; ".join(row["calls"][:3])} for row in rows], _COLUMNS))
    hours = sum(row["hours"] for row in rows)
    changes = sum(row["changes"] for row in rows)
    print(f"{changes} changes reported in {hours:.1f} h of film without any: {changes / hours:.2f} per hour")


if __name__ == "__main__":
    main()
