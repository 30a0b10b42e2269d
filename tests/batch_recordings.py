"""Many very small recordings, and a fake runner."""

from __future__ import annotations

import os
import shutil
from collections.abc import Generator, Iterable
from dataclasses import dataclass, field
from pathlib import Path

from ospc.batch.work import Answer, Task, work
from ospc.simulation import SimulationSettings, simulate

QUICK = (("rounds", "1"), ("points_per_pair", "40"), ("min_points", "30"), ("response_intervals", "8"))
SIZE, FRAMES = (96, 72), 8


def simulated(place: Path, seed: int, **settings: object) -> Path:
    """Simulate a small recording."""
    exposures = (3.0, 6.0, 12.0, 24.0)
    values = {
        "size": SIZE,
        "frames": FRAMES,
        "exposure": "cycle",
        "exposures_ms": exposures,
        "seed": seed,
        "scene_seed": 0,
    }
    simulate(place, SimulationSettings(**(values | settings)))
    return place


def variant(original: Path, place: Path, factor: float) -> Path:
    """Make a recording that has the images of another one but its own exposures and time stamps."""
    place.parent.mkdir(parents=True, exist_ok=True)
    shutil.copytree(original, place, copy_function=os.link)
    lines = [line.split() for line in (original / "times.txt").read_text().splitlines() if line[:1] != "#"]
    (place / "times.txt").unlink()
    (place / "times.txt").write_text(
        "".join(f"{i} {float(stamp) * factor:.6f} {float(e) * factor:.6f}\n" for i, stamp, e in lines)
    )
    return place


@dataclass
class Pretending:
    """A runner in this process that fails on demand and records its tasks.

    Attributes
    ----------
    failing
        Number of remaining failures, by name of the recording.
    asked
        Received tasks: kind and name of the recording.
    """

    failing: dict[str, int] = field(default_factory=dict)
    asked: list[tuple[str, str]] = field(default_factory=list)

    def __call__(self, tasks: Iterable[Task]) -> Generator[Answer, None, None]:
        """Yield the answers in order."""
        for task in tasks:
            name = Path(task.entry.recording).name
            self.asked.append((task.what, name))
            if task.what == "calibrate" and self.failing.get(name, 0) > 0:
                self.failing[name] -= 1
                yield Answer(task.number, error=f"{name} is torn")
            else:
                yield work(task)
