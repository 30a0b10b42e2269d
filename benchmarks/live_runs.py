"""Play simulated recordings to a live calibrator in real time, and compare the result with ospc.calibrate.

    python benchmarks/live_runs.py --results live --recordings 40
    python benchmarks/live_runs.py --results live --recordings 4 --rates 20 --busy 2

The camera never changes. A row shows how many changes were reported nevertheless, whether the result was lost (an
error, or nothing identifiable although the command identifies something), the final errors and those of
ospc.calibrate on the same frames, the longest push, and how many frames were dropped because the calibrator was busy.

Results are stored in a folder, and an interrupted run continues. Recordings are rendered before they are played,
because a real camera costs no processor time either.
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

from ospc import Calibration, Frame, LiveCalibrator, OspcError, calibrate
from ospc.arrays import Image
from ospc.research.source import SimulatedSource
from random_recordings import measured_responses, recordings
from results import Row, errors, measured, table_of

_COLUMNS = (
    "recording", "rate", "busy", "frames", "false changes", "lost", "V", "shape", "kappa", "command V",
    "command shape", "command kappa", "worst push ms", "dropped", "late", "failure",
)  # fmt: skip

_FRAMES = (400, 2000)
"""Fewest and most frames of a recording."""


def identified(calibration: Calibration | None) -> list[str]:
    verdicts = {} if calibration is None else calibration.verdicts
    return [name for name, verdict in verdicts.items() if verdict.known]


Film: TypeAlias = list[tuple[Image, float]]
"""Rendered images and their exposures in ms."""


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
    """Keep the machine busy with processes that burn processor time."""
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


def unchanged(member: SimulatedSource, rate: float, processes: int, command: Row) -> Row:
    """Play a recording and compare the result with the command's."""
    film = [(frame.image, frame.exposure_ms) for frame in member.frames()]
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


def by_command(member: SimulatedSource) -> Row:
    found = calibrate(member.frames())
    return {"identified": identified(found), **errors(found, member.settings, "command ")}


def summary(rows: Sequence[Row]) -> str:
    worse = [row["kappa"] / row["command kappa"] for row in rows if row["kappa"] and row["command kappa"]]
    ratio = f"; κ is {np.median(worse):.2g} times the command's in the median" if worse else ""
    false, lost = (sum(row[name] for row in rows) for name in ("false changes", "lost"))
    return f"{len(rows)} runs: {false} false changes, {lost} results lost{ratio}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--results", type=Path, required=True, help="Folder of the results.")
    parser.add_argument("--recordings", type=int, default=40, help="Number of recordings.")
    parser.add_argument("--seed", type=int, default=0, help="Chooses the family of recordings.")
    parser.add_argument("--rates", type=float, nargs="+", default=[20.0, 50.0], help="Frames per second.")
    parser.add_argument("--busy", type=int, default=0, metavar="N", help="Burn processor time with N processes.")
    arguments = parser.parse_args()
    members = recordings(arguments.recordings, arguments.seed, _FRAMES, measured_responses())
    commands = measured({f"command {m.name}": partial(by_command, m) for m in members}, arguments.results)
    calls = {
        f"live {m.name} {rate:g} {arguments.busy}": partial(unchanged, m, rate, arguments.busy, command)
        for m, command in zip(members, commands, strict=True)
        for rate in arguments.rates
    }
    rows = measured(calls, arguments.results)
    print(table_of("Live runs", rows, _COLUMNS))
    print(summary(rows))


if __name__ == "__main__":
    main()
