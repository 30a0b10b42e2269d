"""Cases that cost nothing, in a module of their own so that other processes can import them."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from ospc.benchmark.case import Figures, Row


@dataclass(frozen=True)
class FakeCase:
    name: str
    shape: float = 0.01
    group: str = "simulated"
    factors: dict[str, str] = field(default_factory=lambda: {"noise": "low"})
    log: Path | None = None
    error: type[BaseException] | None = None

    def describe(self):
        return {"kind": "fake", "name": self.name, "shape": self.shape}

    def rows(self, preset, progress):
        if self.error is not None:
            raise self.error
        if self.log is not None:
            with self.log.open("a") as file:
                file.write(f"{self.name} {preset}\n")
        progress(0.5)
        progress(1.0)
        factor = 1 if preset == "default" else 3
        figures = Figures(response_shape_rmse=factor * self.shape, ratio_bias=-factor * self.shape)
        return [Row(preset, figures, {"response": "identifiable"}, {"response": "because"})]
