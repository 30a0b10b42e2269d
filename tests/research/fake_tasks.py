"""Tasks that cost nothing, in a module of their own so that other processes can import them."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass
from pathlib import Path

from ospc.research.measurement import Measurement


@dataclass(frozen=True)
class FakeTask:
    name: str
    shape: float = 0.01
    log: Path | None = None
    error: type[BaseException] | None = None
    wait_for: Path | None = None

    def describe(self):
        return {"kind": "fake", "shape": self.shape}

    def run(self, progress):
        if self.error is not None:
            raise self.error
        if self.log is not None:
            with self.log.open("a") as file:
                file.write(f"{self.name}\n")
        while self.wait_for is not None and not (self.wait_for.exists() and self.wait_for.read_text()):
            time.sleep(0.05)
        progress(0.5)
        progress(1.0)
        return [asdict(Measurement(self.name, "default", {"response_shape_rmse": self.shape}))]


@dataclass(frozen=True)
class SleepingProgram:
    """A task that starts a program which does not end by itself, and notes its process id."""

    program: object
    source: object
    name: str = "sleeping"

    def describe(self):
        return {"kind": "sleeping"}

    def run(self, _progress):
        return self.program.track(self.source, 0).as_dict()
