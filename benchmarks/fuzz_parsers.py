"""Give every file parser hostile input, guided by coverage, and count the results.

    pip install atheris
    python benchmarks/fuzz_parsers.py --work FOLDER [--inputs 1000000] [--slice 60] [--only NAME] ...

Parsers take turns until each has had its inputs. The first tenth is guided by coverage: libFuzzer mutates one half,
``damage.py`` the other while keeping the structure, and inputs that reach new code form a corpus and are mutated
further. The remaining inputs are damaged files of the corpus, without tracing the code, which is three to ten times
faster. Everything is stored in FOLDER, so that an interrupted run continues; --table only prints the counts.

An input counts as *found* if it is neither read nor rejected by one of our errors on one line, if it takes more than
--seconds of processor time or --megabytes of memory, or if it ends the process. It is stored in FOLDER/found with the
output.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import resource
import shutil
import signal
import struct
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import dataclass
from mmap import mmap
from multiprocessing import get_context
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING

# More threads only slow down such small images.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OPENCV_LOG_LEVEL", "OFF")
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "recording"))

import cv2

from damage import damaged
from results import table_of

if TYPE_CHECKING:
    from parser_targets import Target

MEMORY = "/dev/shm" if Path("/dev/shm").is_dir() else None
"""Folder in memory, if there is one, because inputs are written as files, most of them durably."""

HANGING_S, LOADING_S, SLOWEST = 120, 60, 30
"""Wall-clock limit for an input; processor time beyond a turn by which its process must have ended, because it tries
the whole corpus first; and wall-clock seconds per second of processor time on a busy machine."""

FITTED_TO, GUIDED_SHARE, MOST_FOUND = 100, 0.1, 1000
"""One in this many accepted states is fitted; share of the inputs guided by coverage, because later ones hardly reach
new code; and most found files stored."""

CURRENT = "current"
"""File with the current input, followed by remains of longer ones."""

COUNTS = struct.Struct("<QQQQQ")
"""Inputs, understood, found, microseconds of the slowest, and peak memory in KiB; shared with the child."""


def parsers(folder: Path, guided: bool) -> dict[str, Target]:
    """Return all parsers by name, instrumented if ``guided``; samples are created in an empty folder."""
    observed: AbstractContextManager[None] = nullcontext()
    if guided:
        import atheris

        # The estimation that follows parsing has no new paths to find.
        packages = ["ospc", "PIL", "rosbags", "mcap"]
        observed = atheris.instrument_imports(include=packages, exclude=["ospc.estimation"])
    with observed:
        import file_targets
        from parser_targets import targets
    file_targets.fitted_to = FITTED_TO
    found: dict[str, Target] = targets(folder)
    return found


def longest(target: Target) -> int:
    """Return the longest input of a parser, with room for unpacked archives."""
    return max(4096, *(2 * len(sample) for sample in target.samples))


class Progress:
    """The counts of one parser, in a file that outlives the process."""

    def __init__(self, path: Path) -> None:
        if not path.exists():
            path.write_bytes(bytes(COUNTS.size))
        with path.open("r+b") as stream:
            self._shared = mmap(stream.fileno(), COUNTS.size)

    def read(self) -> list[int]:
        return list(COUNTS.unpack_from(self._shared))

    def add(self, understood: bool, found: bool, spent_s: float) -> None:
        inputs, accepted, wrong, slowest, peak = self.read()
        slowest, peak = (
            max(slowest, int(spent_s * 1e6)),
            max(peak, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss),
        )
        COUNTS.pack_into(self._shared, 0, inputs + 1, accepted + understood, wrong + found, slowest, peak)


@dataclass(frozen=True)
class Campaign:
    """The limits, and the folder of corpora, counts and found inputs."""

    work: Path
    inputs: int
    slice_s: int
    seconds: float
    megabytes: int

    def run(self, only: list[str] | None, guided: bool) -> None:
        """Let the parsers take turns, those with the fewest inputs first, until each has had its inputs."""
        share = GUIDED_SHARE if guided else 1.0
        with suppress(KeyboardInterrupt), tempfile.TemporaryDirectory() as folder:
            tried = parsers(Path(folder), guided)
            waiting = only or list(tried)
            while waiting := [name for name in waiting if self.progress(name).read()[0] < share * self.inputs]:
                for name in sorted(waiting, key=lambda name: self.progress(name).read()[0]):
                    self.turn(name, tried[name], self.fuzz if guided else self.damage)
                    (self.work / "table.md").write_text(self.table() + "\n")

    def place(self, name: str) -> Path:
        place = self.work / "".join(letter if letter.isalnum() else "-" for letter in name)
        (place / "corpus").mkdir(parents=True, exist_ok=True)
        return place

    def progress(self, name: str) -> Progress:
        return Progress(self.place(name) / "counts")

    def turn(self, name: str, target: Target, how: Callable[[str, Target, Path], None]) -> None:
        """Try one parser for one turn in a separate process."""
        place, progress = self.place(name), self.progress(name)
        before = progress.read()[0]
        with tempfile.TemporaryDirectory(dir=MEMORY) as folder:
            # Forked, so that imports and samples need not be repeated.
            child = get_context("fork").Process(target=how, args=(name, target, Path(folder)))
            child.start()
            try:
                child.join(SLOWEST * (self.slice_s + LOADING_S))
            finally:  # also after an interruption
                child.kill()
                child.join()
        for artifact in place.glob("libfuzzer-*"):
            (self.work / "found").mkdir(exist_ok=True)
            shutil.move(artifact, self.work / "found" / f"{place.name}-{artifact.name}")
            progress.add(False, True, 0.0)
        current = place / CURRENT
        if current.exists() and child.exitcode:
            self.keep(name, current.read_bytes(), f"ended the process (exit {child.exitcode})", None)
            progress.add(False, True, 0.0)
        current.unlink(missing_ok=True)
        if progress.read()[0] == before:
            print(f"{name}: no input was tried (exit {child.exitcode}), see {place / 'log.txt'}", flush=True)

    def begin(self, name: str) -> None:
        """Redirect output to the parser's log, and limit the memory of this process."""
        log = os.open(self.place(name) / "log.txt", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(log, sys.stdout.fileno())
        os.dup2(log, sys.stderr.fileno())
        resource.setrlimit(resource.RLIMIT_DATA, (self.megabytes * 2**20,) * 2)

    def fuzz(self, name: str, target: Target, folder: Path) -> None:
        """Try one parser, guided by coverage; never return: the process ends with the turn."""
        import atheris

        place, progress = self.place(name), self.progress(name)
        self.begin(name)
        for number, sample in enumerate(target.samples):
            (place / "corpus" / f"sample-{number}").write_bytes(sample)
        mutated, end_s = False, 0.0

        def mutate(data: bytes, most: int, seed: int) -> bytes:
            nonlocal mutated, end_s
            mutated, end_s = True, end_s or time.process_time() + self.slice_s
            random = Random(seed)
            if random.random() < 0.5:
                return bytes(atheris.Mutate(data, most))
            return damaged(data, target.words, random)[:most]

        def try_one(data: bytes) -> None:
            nonlocal mutated
            # The corpus of earlier turns is tried again at the beginning of each turn; it counts once.
            self.attempt(name, target, data, folder, progress if mutated else None)
            mutated = False
            if end_s and (time.process_time() > end_s or progress.read()[0] >= GUIDED_SHARE * self.inputs):
                os._exit(0)

        limits = [f"-timeout={HANGING_S}", f"-report_slow_units={HANGING_S}", f"-rss_limit_mb={self.megabytes}"]
        limits += [f"-max_len={longest(target)}", f"-seed={progress.read()[0] % 2**31 + 1}", "-detect_leaks=0"]
        command = [sys.argv[0], str(place / "corpus"), *limits, f"-artifact_prefix={place}/libfuzzer-"]
        atheris.Setup(command, try_one, custom_mutator=mutate)
        atheris.Fuzz()

    def damage(self, name: str, target: Target, folder: Path) -> None:
        """Try one parser with damaged inputs of its corpus; never return."""
        place, progress = self.place(name), self.progress(name)
        self.begin(name)
        corpus = [path.read_bytes() for path in sorted((place / "corpus").iterdir())]
        random, most = Random(progress.read()[0]), longest(target)
        end_s = time.process_time() + self.slice_s
        # If an input ends the process, or hangs until the alarm ends it, the parent finds it here.
        (place / CURRENT).write_bytes(bytes(most))
        with (place / CURRENT).open("r+b") as stream, mmap(stream.fileno(), 0) as current:
            while time.process_time() < end_s and progress.read()[0] < self.inputs:
                data = damaged(random.choice(corpus), target.words, random)[:most]
                current[: len(data)] = data
                signal.alarm(HANGING_S)
                self.attempt(name, target, data, folder, progress)
        os._exit(0)

    def attempt(self, name: str, target: Target, data: bytes, folder: Path, progress: Progress | None) -> None:
        """Try one input, count it if ``progress`` is given, and store it if it is found."""
        from parser_targets import attempt

        begun, said, understood = time.process_time(), "", False
        error: Exception | None = None
        try:
            understood = attempt(target, data, folder)
        except Exception as raised:
            error, said = raised, "".join(traceback.format_exception(raised))
        spent = time.process_time() - begun
        if spent > self.seconds:
            said = said or f"took {spent:.1f} s of processor time"
        if said:
            self.keep(name, data, said, error)
            progress = progress or self.progress(name)
        if progress is not None:
            progress.add(understood, bool(said), spent)

    def keep(self, name: str, data: bytes, said: str, error: Exception | None) -> None:
        """Store one input for each point in the code where something went wrong."""
        where = [
            f"{frame.filename}:{frame.lineno}"
            for frame in traceback.extract_tb(error.__traceback__ if error else None)
        ]
        digest = hashlib.sha256(repr((type(error), where or data[:64])).encode()).hexdigest()[:12]
        place = self.work / "found"
        place.mkdir(exist_ok=True)
        path = place / f"{self.place(name).name}-{digest}"
        if not path.exists() and len(list(place.iterdir())) < MOST_FOUND:
            path.write_bytes(data)
            path.with_suffix(".txt").write_text(said, "utf-8", "backslashreplace")

    def table(self) -> str:
        from test_damaged_input import NAMES

        names = ("parser", "inputs", "understood", "corpus", "slowest s", "peak MiB", "found")
        rows = []
        for name in NAMES:
            inputs, understood, found, slowest, peak = self.progress(name).read()
            corpus = len(list((self.place(name) / "corpus").iterdir()))
            counts = (name, inputs, understood, corpus, slowest / 1e6, peak // 1024, found)
            rows.append(dict(zip(names, counts, strict=True)))
        total = {name: sum(row[name] for row in rows) for name in ("inputs", "found")}
        return table_of("Inputs of all parsers", [*rows, {"parser": "all", **total}], names)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--work", type=Path, required=True, help="folder of corpora, counts and found inputs")
    parser.add_argument("--inputs", type=int, default=1_000_000, help="number for each parser")
    parser.add_argument("--slice", type=int, default=60, metavar="SECONDS", help="processor time of a turn")
    parser.add_argument("--only", action="append", metavar="NAME", help="try only this parser")
    parser.add_argument("--seconds", type=float, default=2.0, help="limit of processor time for one input")
    parser.add_argument("--megabytes", type=int, default=1024, help="limit of memory")
    parser.add_argument("--table", action="store_true", help="only print the counts")
    arguments = parser.parse_args()
    campaign = Campaign(arguments.work, arguments.inputs, arguments.slice, arguments.seconds, arguments.megabytes)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    cv2.setNumThreads(1)
    with suppress(KeyboardInterrupt):
        # Separate processes, because imported modules stay instrumented.
        for guided in () if arguments.table else (True, False):
            phase = get_context("fork").Process(target=campaign.run, args=(arguments.only, guided))
            phase.start()
            try:
                phase.join()
            finally:  # also after an interruption
                phase.terminate()
                phase.join()
    print(campaign.table())


if __name__ == "__main__":
    main()
