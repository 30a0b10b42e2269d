"""Play simulated recordings to a live calibrator in real time, and report what it loses against the command.

    python benchmarks/live_runs.py --work /tmp/live --recordings 40
    python benchmarks/live_runs.py --work /tmp/live --recordings 4 --rates 20 --busy 2
    python benchmarks/live_runs.py --work /tmp/live --changes --recordings 8

Without --changes the camera never changes. A row tells how many changes were reported nevertheless, whether the
result was lost (an error, or nothing identifiable where the command finds something), the final errors beside those
of ospc.calibrate on the same frames, the longest push, and how many frames were dropped because the calibrator was
busy. With --changes the camera is switched in mid-recording, and a row tells how long it took until that was
reported, and as what.

Recordings are rendered once and kept in the folder --work, where results.jsonl holds the results: a run that was
interrupted goes on where it stopped. Images are decoded before they are played; a camera costs no time either.
"""

from __future__ import annotations

import argparse
import multiprocessing
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ospc import Calibration, Frame, LiveCalibrator, OspcError, calibrate, open_recording
from ospc.arrays import Image
from ospc.simulation import SimulationSettings
from result_files import ResultFile, Row, table
from simulated_family import Member, errors, family, identified, rendered

CORNER_LOSS = 0.2
"""By how much the vignette at the corner falls in the change of this name."""

REFOCUS = 0.2
"""Moved from the coefficient of R² to that of R⁶: V stays at the corner, and rises by up to 8 % between."""

LATE_FRAMES = 2
CHANGES_FRAMES = 1600
"""Frames of a recording in which the camera is switched, half of them before: at 20 frames/s, 40 s each."""

_COMMON = ("recording", "rate", "busy")
_RUN_COLUMNS = (
    *_COMMON, "frames", "false changes", "lost", "V", "shape", "kappa", "command V", "command shape",
    "command kappa", "worst push ms", "dropped", "late", "failure",
)  # fmt: skip
_CHANGE_COLUMNS = (*_COMMON, "change", "false changes", "delay frames", "delay s", "called", "failure")


@dataclass(frozen=True)
class Film:
    """Decoded frames of a recording, ready to be played."""

    images: list[Image]
    exposures_ms: list[float]

    @classmethod
    def of(cls, place: Path) -> Film:
        """Decode a recording."""
        frames = [(frame.image, frame.exposure_ms) for frame in open_recording(place)]
        return cls([image for image, _ in frames], [exposure_ms for _, exposure_ms in frames])


@dataclass
class Played:
    """What happened while a film was played.

    Attributes
    ----------
    reported
        Frames pushed when a change was reported, and what the calibrator said, one for each change.
    worst_push_ms
        Longest time that a push took.
    late
        Frames that were pushed more than a frame's time late, because the machine was busy.
    dropped
        Frames let go because the calibrator was busy.
    calibration
        The final one; None where that failed.
    failure
        Why it failed; empty where it didn't.
    """

    reported: list[tuple[int, str]]
    worst_push_ms: float = 0.0
    late: int = 0
    dropped: int = 0
    calibration: Calibration | None = None
    failure: str = ""


class ChangeCounter:
    """Counts the changes that a live calibrator has reported, by its epochs or else by its notes."""

    def __init__(self) -> None:
        self._seen: tuple[str, ...] = ()
        self._count = 0

    def new(self, live: LiveCalibrator) -> list[str]:
        """Return what was said of each change that was reported since it was asked last."""
        status = live.status
        fresh = status.notes[_overlap(self._seen, status.notes) :]
        self._seen = status.notes
        said = [note for note in fresh if "changed" in note]
        epochs = getattr(status, "epochs", None) or getattr(live, "epochs", None)
        if epochs is None:
            return said
        count = len(epochs) - 1 - self._count
        self._count += count
        return [*said, *["(no note)"] * count][:count]


def _overlap(before: tuple[str, ...], now: tuple[str, ...]) -> int:
    """Return how many of the notes now are old; only the latest notes are remembered."""
    return next(n for n in range(min(len(before), len(now)), -1, -1) if before[len(before) - n :] == now[:n])


def play(film: Film, rate: float) -> Played:
    """Push a film's frames at a rate in frames/s and return what happened."""
    played, counter = Played([]), ChangeCounter()
    try:
        with LiveCalibrator() as live:
            begun_s = time.perf_counter()
            for index, (image, exposure_ms) in enumerate(zip(film.images, film.exposures_ms, strict=True)):
                due_s = begun_s + index / rate
                time.sleep(max(0.0, due_s - time.perf_counter()))
                played.late += time.perf_counter() > due_s + 1 / rate
                frame = Frame.of_array(image, exposure_ms, index=index, stamp_s=index / rate)
                before_s = time.perf_counter()
                live.push(frame)
                played.worst_push_ms = max(played.worst_push_ms, 1e3 * (time.perf_counter() - before_s))
                played.reported += [(index + 1, note) for note in counter.new(live)]
            played.dropped = live.status.busy
            played.calibration = live.calibration()
            played.reported += [(len(film.images), note) for note in counter.new(live)]
    except OspcError as error:
        played.failure = str(error)
    return played


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


# An unchanged camera.


def unchanged(member: Member, place: Path, rate: float, processes: int, command: Row) -> Row:
    """Play a recording and compare with what the command found."""
    film = Film.of(place)
    with busy(processes):
        played = play(film, rate)
    known = identified(played.calibration)
    return {
        "recording": member.name,
        "rate": rate,
        "busy": processes,
        "frames": len(film.images),
        "false changes": len(played.reported),
        "notes": [note for _, note in played.reported],
        "lost": bool(played.failure) or (not known and bool(command["identified"])),
        "identified": known,
        **errors(played.calibration, member.settings),
        **{name: value for name, value in command.items() if name.startswith("command ")},
        "worst push ms": played.worst_push_ms,
        "dropped": played.dropped,
        "late": played.late,
        "failure": played.failure,
    }


def by_command(member: Member, place: Path) -> Row:
    """Return what ospc.calibrate makes of a recording."""
    found = calibrate(place)
    return {"identified": identified(found), **errors(found, member.settings, "command ")}


# A camera that changes.


def _corner_darker(settings: SimulationSettings) -> SimulationSettings:
    first, *others = settings.vignette_coefficients
    corner = 1 + first + sum(others)
    return replace(settings, vignette_coefficients=(first - CORNER_LOSS * corner, *others))


def _refocused(settings: SimulationSettings) -> SimulationSettings:
    first, second, third = settings.vignette_coefficients
    return replace(settings, vignette_coefficients=(first + REFOCUS, second, third - REFOCUS))


def _other_response(settings: SimulationSettings) -> SimulationSettings:
    return replace(settings, response="filmic" if settings.response == "srgb" else "srgb")


CHANGES: dict[str, Callable[[SimulationSettings], SimulationSettings]] = {
    "corner -20 %": _corner_darker,
    "another response": _other_response,
    "refocus": _refocused,
    "exposures 2 late": lambda settings: settings,
}
"""What the settings of the camera become."""


def changing_members(count: int) -> list[Member]:
    """Return the recordings in which the camera is switched: of equal length, with light enough for a refocus."""
    return [
        Member(
            f"changing-{member.name}",
            replace(
                member.settings,
                frames=CHANGES_FRAMES,
                exposure="auto",
                vignette_coefficients=(-0.35, 0.05, -0.15),
                motion="handheld",
            ),
        )
        for member in family(count, seed=1)
    ]


def switched(before: Film, after: Film, change: str) -> Film:
    """Return a film whose second half is of the changed camera."""
    half = len(before.images) // 2
    exposures = [*before.exposures_ms[:half], *after.exposures_ms[half:]]
    if change == "exposures 2 late":
        exposures[half:] = before.exposures_ms[half - LATE_FRAMES : -LATE_FRAMES]
    return Film([*before.images[:half], *after.images[half:]], exposures)


def changed(member: Member, film: Film, change: str, rate: float, processes: int) -> Row:
    """Play a film in which the camera is switched, and tell when that was reported."""
    half = len(film.images) // 2
    with busy(processes):
        played = play(film, rate)
    reported = [(pushed, note) for pushed, note in played.reported if pushed > half]
    delay = reported[0][0] - half if reported else None
    return {
        "recording": member.name,
        "rate": rate,
        "busy": processes,
        "change": change,
        "false changes": len(played.reported) - len(reported),
        "delay frames": delay,
        "delay s": None if delay is None else delay / rate,
        "called": reported[0][1] if reported else "never reported",
        "notes": [note for _, note in played.reported],
        "dropped": played.dropped,
        "late": played.late,
        "failure": played.failure,
    }


# The program.


def run_unchanged(arguments: argparse.Namespace, results: ResultFile) -> list[Row]:
    members = family(arguments.recordings, arguments.seed)
    places = rendered(members, arguments.work / "recordings")
    keys = []
    for member in members:
        reference = f"command {member.name}"
        if reference not in results:
            results.add(reference, by_command(member, places[member.name]))
        for rate in arguments.rates:
            key = f"live {member.name} {rate:g} {arguments.busy}"
            keys.append(key)
            if key not in results:
                row = unchanged(member, places[member.name], rate, arguments.busy, results[reference])
                results.add(key, row)
                print(key, "done", flush=True)
    return results.rows(keys)


def run_changes(arguments: argparse.Namespace, results: ResultFile) -> list[Row]:
    members = changing_members(arguments.recordings)
    cameras = [
        replace(member, name=_place_of(member, change), settings=make(member.settings))
        for member in members
        for change, make in CHANGES.items()
        if make(member.settings) != member.settings
    ]
    places = rendered([*members, *cameras], arguments.work / "recordings")
    keys = []
    for member in members:
        before = Film.of(places[member.name])
        for change in CHANGES:
            after = Film.of(places.get(_place_of(member, change), places[member.name]))
            film = switched(before, after, change)
            for rate in arguments.rates:
                key = f"change {member.name} {change} {rate:g} {arguments.busy}"
                keys.append(key)
                if key not in results:
                    results.add(key, changed(member, film, change, rate, arguments.busy))
                    print(key, "done", flush=True)
    return results.rows(keys)


def _place_of(member: Member, change: str) -> str:
    return f"{member.name}-{change.replace(' ', '-').replace('%', 'percent')}"


def summary(rows: Sequence[Row]) -> str:
    """Return the totals over all runs in a line."""
    if "change" in rows[0]:
        delays = [row["delay s"] for row in rows if row["delay s"] is not None]
        middle = f", after {statistics.median(delays):.1f} s in the median" if delays else ""
        return f"{len(delays)} of {len(rows)} changes reported{middle}; {_total(rows)} false changes before"
    worse = [row["kappa"] / row["command kappa"] for row in rows if row["kappa"] and row["command kappa"]]
    ratio = f"; κ is {np.median(worse):.2g} times the command's in the median" if worse else ""
    return f"{len(rows)} runs: {_total(rows)} false changes, {sum(row['lost'] for row in rows)} results lost{ratio}"


def _total(rows: Sequence[Row]) -> int:
    return sum(row["false changes"] for row in rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--work", type=Path, required=True, help="Folder for the recordings and the results.")
    parser.add_argument("--recordings", type=int, default=40, help="Number of recordings.")
    parser.add_argument("--seed", type=int, default=0, help="Chooses the family of recordings.")
    parser.add_argument("--rates", type=float, nargs="+", default=[20.0, 50.0], help="Frames per second.")
    parser.add_argument("--busy", type=int, default=0, metavar="N", help="Burn processor time with N processes.")
    parser.add_argument("--changes", action="store_true", help="Switch the camera in mid-recording.")
    arguments = parser.parse_args()
    results = ResultFile(arguments.work / "results.jsonl")
    rows = (run_changes if arguments.changes else run_unchanged)(arguments, results)
    print(table(rows, _CHANGE_COLUMNS if arguments.changes else _RUN_COLUMNS))
    print(summary(rows))


if __name__ == "__main__":
    main()
