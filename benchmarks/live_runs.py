"""Play simulated recordings to a live calibrator in real time, and report what it loses against the command.

    python benchmarks/live_runs.py --work /tmp/live --recordings 40
    python benchmarks/live_runs.py --work /tmp/live --recordings 4 --rates 20 --busy 2

The camera never changes. A row tells how many changes were reported nevertheless, whether the
result was lost (an error, or nothing identifiable where the command finds something), the final errors beside those
of ospc.calibrate on the same frames, the longest push, and how many frames were dropped because the calibrator was
busy.

Recordings are rendered once and kept in the folder --work, which holds the results too: an interrupted run goes
on where it stopped. Images are decoded before they are played; a camera costs no time either.
"""

from __future__ import annotations

import argparse
import multiprocessing
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TypeAlias

import numpy as np

from ospc import Calibration, Frame, LiveCalibrator, OspcError, calibrate, open_recording
from ospc.arrays import Image
from ospc.research.source import SimulatedSource
from results import Row, measured, table_of
from simulated_family import errors, family, identified, rendered

_COLUMNS = (
    "recording", "rate", "busy", "frames", "false changes", "lost", "V", "shape", "kappa", "command V",
    "command shape", "command kappa", "worst push ms", "dropped", "late", "failure",
)  # fmt: skip


Film: TypeAlias = list[tuple[Image, float]]
"""Decoded images, ready to be played, and their exposures in ms."""


def play(film: Film, rate: float) -> tuple[Calibration | None, Row]:
    worst_push_s, late, found = 0.0, 0, None
    try:
        with LiveCalibrator() as live:
            begun_s = time.perf_counter()
            for index, (image, exposure_ms) in enumerate(film):
                due_s = begun_s + index / rate
                time.sleep(max(0.0, due_s - time.perf_counter()))
                late += time.perf_counter() > due_s + 1 / rate
                frame = Frame.of_array(image, exposure_ms, index=index, stamp_s=index / rate)
                before_s = time.perf_counter()
                live.push(frame)
                worst_push_s = max(worst_push_s, time.perf_counter() - before_s)
            found, status = live.calibration(), live.status
    except OspcError as error:
        return None, {"failure": str(error), "notes": [], "worst push ms": 1e3 * worst_push_s, "late": late}
    notes = [epoch.change.text for epoch in status.epochs if epoch.change]
    counts = {"dropped": status.dropped, "worst push ms": 1e3 * worst_push_s, "late": late}
    return found, {**counts, "notes": notes, "failure": ""}


@contextmanager
def busy(processes: int) -> Iterator[None]:
    """Keep the machine busy with processes that do nothing but burn processor time."""
    burning = [multiprocessing.Process(target=_burn, daemon=True) for _ in range(processes)]
    for process in burning:
        process.start()
    try:
        yield
    finally:
        for process in burning:
            process.terminate()
            process.join()


def _burn() -> None:
    while True:
        sum(range(100_000))


def unchanged(member: SimulatedSource, place: Path, rate: float, processes: int, command: Row) -> Row:
    """Play a recording and compare with what the command found."""
    film = [(frame.image, frame.exposure_ms) for frame in open_recording(place)]
    with busy(processes):
        calibration, played = play(film, rate)
    known = identified(calibration)
    about = {"recording": member.name, "rate": rate, "busy": processes, "frames": len(film)}
    return about | {
        **played,
        "false changes": len(played["notes"]),
        "lost": bool(played["failure"]) or (not known and bool(command["identified"])),
        "identified": known,
        **errors(calibration, member.settings),
        **{name: value for name, value in command.items() if name.startswith("command ")},
    }


def by_command(member: SimulatedSource, place: Path) -> Row:
    found = calibrate(place)
    return {"identified": identified(found), **errors(found, member.settings, "command ")}


def summary(rows: Sequence[Row]) -> str:
    worse = [row["kappa"] / row["command kappa"] for row in rows if row["kappa"] and row["command kappa"]]
    ratio = f"; κ is {np.median(worse):.2g} times the command's in the median" if worse else ""
    false, lost = (sum(row[name] for row in rows) for name in ("false changes", "lost"))
    return f"{len(rows)} runs: {false} false changes, {lost} results lost{ratio}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--work", type=Path, required=True, help="Folder for the recordings and the results.")
    parser.add_argument("--recordings", type=int, default=40, help="Number of recordings.")
    parser.add_argument("--seed", type=int, default=0, help="Chooses the family of recordings.")
    parser.add_argument("--rates", type=float, nargs="+", default=[20.0, 50.0], help="Frames per second.")
    parser.add_argument("--busy", type=int, default=0, metavar="N", help="Burn processor time with N processes.")
    arguments = parser.parse_args()
    members = family(arguments.recordings, arguments.seed)
    places = rendered(members, arguments.work / "recordings")
    results = arguments.work / "results"
    commands = measured({f"command {m.name}": partial(by_command, m, places[m.name]) for m in members}, results)
    calls = {
        f"live {m.name} {rate:g} {arguments.busy}": partial(
            unchanged, m, places[m.name], rate, arguments.busy, command
        )
        for m, command in zip(members, commands, strict=True)
        for rate in arguments.rates
    }
    rows = measured(calls, results)
    print(table_of("Live runs", rows, _COLUMNS))
    print(summary(rows))


if __name__ == "__main__":
    main()
