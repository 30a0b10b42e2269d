"""Give every parser of files as many damaged inputs as one likes, and count what comes of them.

    python benchmarks/fuzz_parsers.py [--inputs 100000] [--first 0] [--only NAME] ...

Inputs are numbered and the same in every run. One that is neither understood nor refused by an error of ours ends the
run with its number. Prints for each parser how many inputs it understood, the processor time of the slowest, and the
peak of the memory.
"""

from __future__ import annotations

import argparse
import os
import resource
import sys
import tempfile
import time
from pathlib import Path

# A thread for each core would only fight the others for such small images.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENCV_LOG_LEVEL", "OFF")
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "recording"))

import cv2
from parser_targets import Target, attempt, damaged_at_random, targets

MEMORY = Path("/dev/shm")
"""Folder in memory, where there is one: inputs are written as files, most of them durably."""


def fuzz(name: str, target: Target, inputs: range, folder: Path) -> str:
    """Try all inputs and say what came of them."""
    accepted, slowest_s = 0, 0.0
    for number in inputs:
        data = damaged_at_random(target, number)
        begun = time.process_time()
        try:
            accepted += attempt(target, data, folder)
        except BaseException:
            print(f"{name}: input {number} is neither understood nor refused", flush=True)
            raise
        slowest_s = max(slowest_s, time.process_time() - begun)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return (
        f"{name:26} {len(inputs):8d} inputs, {accepted:7d} understood, slowest {slowest_s:6.3f} s, "
        f"peak memory of the process {peak:5.0f} MiB"
    )


def main() -> None:
    """Try all parsers, or those that are named."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--inputs", type=int, default=100_000, help="how many for each parser")
    parser.add_argument("--first", type=int, default=0, metavar="NUMBER", help="number of the first")
    parser.add_argument("--only", action="append", metavar="NAME", help="this parser")
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    with tempfile.TemporaryDirectory(dir=MEMORY if MEMORY.is_dir() else None) as folder:
        known = targets(Path(folder))
        # Decoders written in C have their own remarks on every damaged image.
        kept = os.dup(2)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
        try:
            for name in arguments.only or known:
                inputs = range(arguments.first, arguments.first + arguments.inputs)
                print(fuzz(name, known[name], inputs, Path(folder)), flush=True)
        finally:
            os.dup2(kept, 2)


if __name__ == "__main__":
    main()
