"""Kill and disturb long-running commands, let them continue, and compare the output with an undisturbed run.

    python benchmarks/kills_and_faults.py --results FOLDER [--kills 40] [--runs 10] [--only CASE] [--commands NAME]

Each case disturbs calibrate, live, correct, merge, batch and experiments at random moments. Then the command is run
again as documented (with --resume, with --force, or unchanged), and every file must equal that of the undisturbed run
bit for bit, except for measured times. After each disturbance, every file must be complete by the rules of its
format, and an error must be one sentence of ours. Needs root, to mount full and read-only disks in memory, and the
program faketime, to change the clock. Results are stored in a folder, and an interrupted run continues.
"""

from __future__ import annotations

import argparse
import csv
import io
import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import zipfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import cv2
import numpy as np

from ospc.errors import OspcError
from ospc.simulation import SimulationSettings, simulate
from ospc.state import container
from results import Row, measured, table_of

PROGRAM = "from ospc.cli.main import main; main()"
SETTINGS = ("--set", "points_per_pair=100", "--set", "max_points=3000", "--set", "rounds=4")
SIZE = (160, 120)
FRAMES = 30
HANGING_S, ANSWER_S = 180, 10
"""Time limits for a command, which takes a few seconds undisturbed, and for reacting to Ctrl-C on a busy machine."""

MOST_IN_A_ROW = 4
"""Most disturbances before a run may continue to its end."""

MEASURED = {"seconds", "worker", "attempts"}
"""Table columns that differ between runs because they are measured."""

COMMANDS = ("calibrate", "live", "correct", "merge", "batch", "experiments")

ENDED_WELL = (0, 3)
"""Exit codes with a result; 3 means a limited result."""

SENTENCES = {1: ("ospc: error: ", "OpenBLAS error: Memory allocation still failed"), 4: ("failed: ",)}
"""Beginning of the message for an exit code; OpenBLAS ends the process with its own message if memory runs out."""

Command: TypeAlias = tuple[tuple[str, ...], tuple[str, ...]]
"""The arguments of a command, and further ones to continue after it was stopped."""


@dataclass
class Outcome:
    """The result of disturbing a command and letting it continue."""

    command: str
    runs: int = 0
    early: int = 0
    refused: int = 0
    lost: int = 0
    wrong: int = 0
    torn: int = 0
    hangs: int = 0
    answer_s: float | None = None
    remarks: list[str] = field(default_factory=list)


COUNTS = ("runs", "early", "refused", "lost", "wrong", "torn", "hangs")
"""The counts of an outcome; "early" counts commands that ended before they were disturbed."""


def commands(work: Path) -> dict[str, Command]:
    """Return the commands; OUT stands for the output folder."""
    one, two = (str(work / "recordings" / name) for name in ("one", "two"))
    out, states = ("-o", "OUT", "-q"), [str(work / "calibrated" / name) for name in ("one", "two")]
    resuming = ("--resume", "--checkpoint-every", "0")
    small = ("--count", "1", "--frames", "10", "--size", "96x72")
    return {
        "calibrate": (("calibrate", one, *out, *SETTINGS, *resuming), ()),
        "live": (("live", one, *out, "--no-page", "--pace", "0", "--goal", "0"), ("--force",)),
        "correct": (("correct", one, states[0], *out), ("--force",)),
        "merge": (("merge", *states, *out), ("--force",)),
        "batch": (("batch", str(work / "recordings"), *out, "-j", "2", *SETTINGS[:2]), ()),
        "experiments": (("experiments", "static", *out[:2], *small), ()),
        "of one": (("calibrate", one, *out, *SETTINGS), ()),
        "of two": (("calibrate", two, *out, *SETTINGS), ()),
    }


def started(
    command: Command, out: Path, *, again: bool, before: Callable[[], None] | None = None, **environment: str
) -> subprocess.Popen[bytes]:
    """Start a command as a process group of its own."""
    arguments = [str(out) if argument == "OUT" else argument for argument in command[0]]
    return subprocess.Popen(
        [sys.executable, "-c", PROGRAM, *arguments, *(command[1] if again else ())],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
        preexec_fn=before,  # noqa: PLW1509  (this process has no other threads that hold locks)
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", **environment},
    )


def ended(process: subprocess.Popen[bytes], most_s: float = HANGING_S) -> tuple[int | None, str]:
    """Return exit code and errors; the code is None if the command hung and was killed."""
    try:
        _, errors = process.communicate(timeout=most_s)
    except subprocess.TimeoutExpired:
        killed(process)
        return None, process.communicate()[1].decode("utf-8", "replace")
    return process.returncode, errors.decode("utf-8", "replace")


def killed(process: subprocess.Popen[bytes]) -> None:
    """Kill a command and its workers, as the kernel does when memory runs out."""
    os.killpg(process.pid, signal.SIGKILL)


def content(folder: Path) -> dict[str, bytes]:
    """Return all files of an output folder, without measured values."""
    found = {}
    for place in sorted(folder.rglob("*")):
        if place.is_file():
            name = place.relative_to(folder).as_posix()
            found[name] = place.read_bytes()
            if name.endswith(".csv"):
                rows = csv.DictReader(place.read_text().splitlines())
                found[name] = repr([{k: v for k, v in row.items() if k not in MEASURED} for row in rows]).encode()
            elif "/cache/" in f"/{name}":
                found[name] = b""
    return found


def differing(one: dict[str, bytes], other: dict[str, bytes]) -> list[str]:
    return sorted(name for name in one.keys() | other.keys() if one.get(name) != other.get(name))


def torn(folder: Path) -> list[str]:
    """Return the incomplete files, except those named as unfinished."""
    return [
        place.relative_to(folder).as_posix()
        for place in sorted(folder.rglob("*"))
        if place.is_file() and not place.name.endswith(".part") and not whole(place)
    ]


def whole(place: Path) -> bool:
    data = place.read_bytes()
    rule = RULES.get(place.suffix, ends_with_a_line)
    try:
        return place.name in JOURNALS or bool(rule(data))
    except (ValueError, OspcError, zipfile.BadZipFile):
        return False


def ends_with_a_line(data: bytes) -> bool:
    return data.endswith(b"\n")


def decodable(data: bytes) -> bool:
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    return image is not None and (b"PNG" not in data[:8] or data.endswith(b"IEND\xaeB`\x82"))


JOURNALS = ("written.txt",)
"""Files that grow line by line; readers ignore an incomplete line."""

RULES: dict[str, Callable[[bytes], object]] = {
    ".json": lambda data: json.loads(data) is not None,
    ".ospc": lambda data: container.from_bytes(data, "state") is not None,
    ".npz": lambda data: zipfile.ZipFile(io.BytesIO(data)).testzip() is None,
    ".html": lambda data: data.rstrip().endswith(b"</html>"),
    **dict.fromkeys((".png", ".tif", ".tiff", ".jpg"), decodable),
}
"""Checks that a file is complete, by its suffix; all other files are texts of complete lines."""


class Tester:
    """Runs cases in a folder of recordings."""

    def __init__(self, work: Path, rng: random.Random) -> None:
        self.work, self.rng = work, rng
        for seed, name in enumerate(("one", "two")):
            settings = SimulationSettings(
                size=SIZE, frames=FRAMES, exposure="cycle", exposures_ms=(3.0, 6.0, 12.0, 24.0), seed=seed
            )
            simulate(work / "recordings" / name, settings)
        self.commands = commands(work)
        for name in ("one", "two"):
            self._undisturbed(self.commands.pop(f"of {name}"), work / "calibrated" / name)
        self.duration_s: dict[str, float] = {}
        self.expected: dict[str, dict[str, bytes]] = {}

    def prepare(self, name: str) -> None:
        if name not in self.expected:
            found = []
            for _ in range(2):
                out = self.work / "undisturbed"
                shutil.rmtree(out, ignore_errors=True)
                begun_s = time.monotonic()
                self._undisturbed(self.commands[name], out)
                self.duration_s[name] = time.monotonic() - begun_s
                found.append(content(out))
            if different := differing(*found):
                sys.exit(f"{name}: two undisturbed runs differ in {different}")
            self.expected[name] = found[1]

    def _undisturbed(self, command: Command, out: Path) -> None:
        code, errors = ended(started(command, out, again=False))
        if code not in ENDED_WELL:
            sys.exit(f"undisturbed {command[0]} failed: {errors}")

    def judge(self, row: Outcome, out: Path, code: int | None, errors: str) -> None:
        row.runs += 1
        lines = [line for line in errors.splitlines() if line.strip()]
        if code is None:
            row.hangs += 1
            row.remarks.append(f"hung: {errors[-200:]}")
        elif "Traceback" in errors or "unexpected" in errors:
            row.wrong += 1
            row.remarks.append(errors[-800:])
        elif code in SENTENCES:
            row.refused += 1
            if not any(line.startswith(SENTENCES[code]) for line in lines):
                row.wrong += 1
                row.remarks.append(f"exit {code} without a sentence: {errors[-300:]}")
        elif code not in (*ENDED_WELL, 130, -signal.SIGKILL):
            row.wrong += 1
            row.remarks.append(f"exit {code}: {errors[-300:]}")
        if broken := torn(out) if out.is_dir() else []:
            row.torn += 1
            row.remarks.append(f"torn: {broken}")

    def complete(self, row: Outcome, out: Path) -> None:
        """Let the command continue undisturbed, and compare."""
        name = row.command
        if out.is_dir() and content(out) == self.expected[name]:
            shutil.rmtree(out)
            return
        code, errors = ended(started(self.commands[name], out, again=True))
        if code not in ENDED_WELL:
            row.lost += code is not None
            row.hangs += code is None
            row.remarks.append(f"did not go on, exit {code}: {errors[-500:]}")
        elif different := differing(content(out), self.expected[name]):
            row.wrong += 1
            row.remarks.append(f"differ: {different[:6]}")
        shutil.rmtree(out, ignore_errors=True)

    def start(self, row: Outcome, out: Path, *, again: bool = False, **more: Any) -> subprocess.Popen[bytes]:
        return started(self.commands[row.command], out, again=again, **more)

    def runs_on(self, row: Outcome, process: subprocess.Popen[bytes]) -> bool:
        """Wait for a random time, and return whether the command is still running."""
        try:
            process.wait(self.rng.uniform(0, self.duration_s[row.command]))
        except subprocess.TimeoutExpired:
            return True
        row.early += 1
        return False


def kill(tester: Tester, row: Outcome, out: Path, _share: float) -> None:
    """SIGKILL for the command and its workers, a few times in a row."""
    for number in range(tester.rng.randint(1, MOST_IN_A_ROW)):
        process = tester.start(row, out, again=number > 0 and out.exists())
        if tester.runs_on(row, process):
            killed(process)
        tester.judge(row, out, *ended(process))
    tester.complete(row, out)


def interrupt(tester: Tester, row: Outcome, out: Path, _share: float) -> None:
    """Ctrl-C, and a second one if the first means 'finish early'."""
    process = tester.start(row, out)
    if not tester.runs_on(row, process):
        tester.judge(row, out, *ended(process))
        tester.complete(row, out)
        return
    begun_s = time.monotonic()
    os.killpg(process.pid, signal.SIGINT)
    try:
        process.wait(ANSWER_S / 2)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGINT)
    code, errors = ended(process, ANSWER_S)
    row.answer_s = time.monotonic() - begun_s
    # Before the command itself runs, Python handles the interruption.
    if "KeyboardInterrupt" in errors and "ospc/cli/main.py" not in errors.replace("ospc.cli.main", ""):
        code, errors = 130, ""
    tester.judge(row, out, 130 if code == -signal.SIGINT else code, errors)
    tester.complete(row, out)


def signals(tester: Tester, row: Outcome, out: Path, _share: float) -> None:
    """Signals a hundred times a second, which interrupt reads and writes and pause the process."""
    kinds = (signal.SIGWINCH, signal.SIGCONT, signal.SIGCHLD, signal.SIGURG, signal.SIGSTOP)
    process = tester.start(row, out)
    end_s = time.monotonic() + HANGING_S
    while process.poll() is None and time.monotonic() < end_s:
        os.killpg(process.pid, tester.rng.choice(kinds))
        time.sleep(0.01)
        os.killpg(process.pid, signal.SIGCONT)
    tester.judge(row, out, *ended(process))
    tester.complete(row, out)


def memory(tester: Tester, row: Outcome, out: Path, share: float) -> None:
    """A limit on the address space, from less than Python needs to more than the command uses."""
    most = int(2**20 * (200 + 1400 * share))
    process = tester.start(row, out, before=lambda: resource.setrlimit(resource.RLIMIT_AS, (most, most)))
    code, errors = ended(process)
    if "OpenBLAS" in errors or "ImportError" in errors or "MemoryError" in errors:
        row.remarks.append(f"{most // 2**20} MiB, exit {code}: {errors.strip()[-300:]}")
    tester.judge(row, out, code, errors)
    tester.complete(row, out)


@contextmanager
def disk(place: Path, kilobytes: int) -> Iterator[Path]:
    """Mount a disk of this size in memory."""
    place.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={kilobytes}k", "none", str(place)], check=True)
    try:
        yield place
    finally:
        subprocess.run(["umount", "-l", str(place)], check=True)
        place.rmdir()


def remounted(place: Path, option: str) -> bool:
    done = subprocess.run(["mount", "-o", f"remount,{option}", str(place)], capture_output=True, check=False)
    return done.returncode == 0


def full_disk(tester: Tester, row: Outcome, _out: Path, _share: float) -> None:
    """A disk that becomes full at a random size of the output, and then has space again."""
    needed = sum(map(len, tester.expected[row.command].values())) // 1024
    with disk(tester.work / "disk", 8 + int(tester.rng.random() * needed)) as place:
        tester.judge(row, place / "out", *ended(tester.start(row, place / "out")))
        assert remounted(place, "size=200m")
        tester.complete(row, place / "out")


def read_only(tester: Tester, row: Outcome, _out: Path, share: float) -> None:
    """A disk that becomes read-only at a random moment, as one with errors does, or is from the beginning."""
    with disk(tester.work / "disk", 200 * 1024) as place:
        from_the_beginning = share > 1 / 2 and remounted(place, "ro")
        process = tester.start(row, place / "out")
        if tester.runs_on(row, process) and not from_the_beginning:
            # Remounting is refused while a file is open for writing.
            while process.poll() is None and not remounted(place, "ro"):
                time.sleep(0.002)
        tester.judge(row, place / "out", *ended(process))
        assert remounted(place, "rw")
        tester.complete(row, place / "out")


def removed_input(tester: Tester, row: Outcome, out: Path, _share: float) -> None:
    """The input is moved away at a random moment, and back before the command continues."""
    place = tester.work / ("calibrated" if row.command == "merge" else "recordings")
    process = tester.start(row, out)
    tester.runs_on(row, process)
    moved = place.rename(place.with_name(f"{place.name}-moved"))
    found = ended(process)
    moved.rename(place)
    tester.judge(row, out, *found)
    tester.complete(row, out)


def clock(tester: Tester, row: Outcome, out: Path, share: float) -> None:
    """The clock is set forward by an hour or back by a day at a random moment."""
    found = sorted(Path("/usr/lib").glob("*/faketime/libfaketimeMT.so.1"))
    if not found:
        sys.exit("the case 'clock' needs the program faketime")
    setting = tester.work / "clock"
    setting.write_text("+0")
    process = tester.start(
        row,
        out,
        LD_PRELOAD=str(found[0]),
        FAKETIME_TIMESTAMP_FILE=str(setting),
        FAKETIME_NO_CACHE="1",
        FAKETIME_DONT_FAKE_MONOTONIC="1",
    )
    tester.runs_on(row, process)
    setting.write_text("+3600" if share < 1 / 3 else "-86400")
    tester.judge(row, out, *ended(process))
    tester.complete(row, out)


Case: TypeAlias = Callable[[Tester, Outcome, Path, float], None]
"""Disturbs a command, judges it and lets it continue; gets an output folder and the share of earlier runs."""

CASES: dict[str, Case] = {
    "kill": kill,
    "interrupt": interrupt,
    "signals": signals,
    "full disk": full_disk,
    "read-only": read_only,
    "input removed": removed_input,
    "clock": clock,
    "memory": memory,
}


def disturbed(tester: Tester, case: str, name: str, share: float) -> Row:
    """Disturb a command once."""
    tester.prepare(name)
    outcome = Outcome(name)
    CASES[case](tester, outcome, tester.work / "out", share)
    for remark in outcome.remarks:
        print(f"{case}, {name}: {remark}", flush=True)
    return {"case": case, **asdict(outcome)}


def totals(rows: Sequence[Row]) -> list[Row]:
    """Return the totals for each case and command, and the slowest reaction."""
    found: list[Row] = []
    for names in dict.fromkeys((row["case"], row["command"]) for row in rows):
        mine = [row for row in rows if (row["case"], row["command"]) == names]
        counts = {name: sum(row[name] for row in mine) for name in COUNTS}
        answers = [row["answer_s"] for row in mine if row["answer_s"] is not None]
        found.append(
            {"case": names[0], "command": names[1], **counts, "slowest answer s": max(answers, default=None)}
        )
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--results", type=Path, required=True)
    parser.add_argument("--kills", type=int, default=40, help="number of runs in which a command is killed")
    parser.add_argument("--runs", type=int, default=10, help="number of runs in each other case")
    parser.add_argument("--only", action="append", choices=list(CASES), help="run only this case")
    parser.add_argument("--commands", action="append", metavar="NAME", help="run only this command")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        tester = Tester(Path(folder), random.Random(time.time_ns()))
        calls = {
            f"{case}, {name} {number}": partial(disturbed, tester, case, name, number / runs)
            for case in arguments.only or CASES
            for runs in (arguments.kills if case == "kill" else arguments.runs,)
            for name in arguments.commands or COMMANDS
            for number in range(runs)
        }
        rows = measured(calls, arguments.results)
    print(table_of("Disturbed commands", totals(rows), ("case", "command", *COUNTS, "slowest answer s"), names=2))


if __name__ == "__main__":
    main()
