"""``ospc simulate``: simulate a recording with known truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ospc.cli.options import SIZE, Parsed, argument, declared, option
from ospc.cli.terminal import progress_of, say
from ospc.errors import SettingError
from ospc.exposures.table import range_in_words

if TYPE_CHECKING:
    from ospc.simulation import SimulationSettings


def _numbers(text: str) -> tuple[float, ...]:
    try:
        return tuple(float(part) for part in text.replace(",", " ").split())
    except ValueError:
        raise SettingError(f"'{text}' is not a list of numbers, such as 1,2,4") from None


_NUMBERS = Parsed("numbers", _numbers)

_USED_WITH: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "exposure_range": ("exposure", ("auto", "sweep")),
    "exposures": ("exposure", ("cycle", "constant")),
    "exposure_file": ("exposure", ("file",)),
    "vignette_coefficients": ("vignette", ("polynomial", "decentred")),
}
"""The other option, and its values, with which alone an option has an effect."""


@dataclass(frozen=True)
class _Simulation:
    """Simulate a recording with known truth and write it to the folder OUT.

    OUT gets images, times.txt and camera.txt like a real recording, and the truth in pcalib.txt, vignette.png,
    groundtruthSync.txt and truth.json.
    """

    out: Path = argument(reserve=True)
    frames: int = option("Number of images.", default=500)
    size: tuple[int, int] = option("Width x height in pixels.", default="640x480", type=SIZE)
    fps: float = option("Images per second.", default=20.0)
    seed: int = option("Seed of scene, motion and noise.", default=0)
    response: str = option("linear, srgb, gamma2.2, log, filmic, tum_narrow, or a pcalib.txt.", default="gamma2.2")
    vignette: str = option("none, polynomial, cos4, decentred, or a vignette.png.", default="polynomial")
    vignette_coefficients: tuple[float, ...] | None = option(
        "Vignette 1 + V1 R² + V2 R⁴ + V3 R⁶ with R = 1 at the corner.", metavar="V1,V2,V3", type=_NUMBERS
    )
    noise: str = option(None, type=click.Choice(["none", "low", "high"]), default="low")
    exposure: str = option(
        "How the exposures are set.",
        type=click.Choice(["auto", "sweep", "cycle", "file", "constant"]),
        default="auto",
    )
    exposure_range: tuple[float, float] | None = option(
        "Limits of auto and sweep, in ms.", nargs=2, type=float, metavar="MIN MAX"
    )
    exposures: tuple[float, ...] | None = option(
        "Exposures for cycle, in ms; a single one for constant.", metavar="MS,MS,…", type=_NUMBERS
    )
    exposure_file: Path | None = option(
        "Text file with exposures in ms in its last column, such as times.txt; for file.",
        type=click.Path(path_type=Path, dir_okay=False),
    )
    motion: str = option(None, type=click.Choice(["handheld", "static", "pan", "forward"]), default="handheld")
    speed: float = option("Speed factor of the motion.", default=1.0)
    lag: int = option("Lag of the exposure metadata in frames.", default=0)
    metadata_error: float = option("Relative standard deviation of errors in the exposure metadata.", default=0.0)
    flicker: float = option("Relative amplitude of the flicker of the light.", default=0.0)
    moving_objects: int = option("Number of patches moving in front of the scene.", default=0)
    motion_blur_samples: int = option("Number of instants averaged per frame.", "--motion-blur", default=1)
    bit_depth: int = option("Bits per grey value, 8 to 16.", default=8)
    jpg: bool = option("Store JPEG instead of PNG.")
    archive: bool = option("Store images.zip instead of the folder images.")
    force: bool = option("Replace an earlier simulated recording at OUT.")

    def run(self) -> None:
        from ospc.simulation import simulate

        settings = self._settings()
        with progress_of("simulating") as step:
            made = simulate(self.out, settings, overwrite=self.force, progress=step)
        low, high = made.exposures_ms.min(), made.exposures_ms.max()
        say(
            f"{self.out}: {settings.frames} frames of {settings.size[0]}×{settings.size[1]} pixels, exposures "
            f"{range_in_words(low, high)}; truth in {self.out / 'truth.json'}, pcalib.txt and vignette.png"
        )

    def _settings(self) -> SimulationSettings:
        from ospc.recording.table_text import exposures_in
        from ospc.simulation import SimulationSettings

        for name, (other, values) in _USED_WITH.items():
            if getattr(self, name) and getattr(self, other) not in values:
                flag = name.replace("_", "-")
                raise SettingError(f"--{flag} requires --{other} {' or '.join(values)}; add it")
        own = {"out", "force", "jpg", *_USED_WITH}
        options = {name: value for name, value in vars(self).items() if name not in own}
        options["image_format"] = "jpg" if self.jpg else "png"
        if self.exposure_range:
            options["exposure_min_ms"], options["exposure_max_ms"] = self.exposure_range
        if self.exposures:
            if self.exposure == "constant" and len(self.exposures) > 1:
                count = len(self.exposures)
                raise SettingError(
                    f"--exposure constant takes a single exposure, not {count}; give one, or use cycle"
                )
            options["exposures_ms"], options["exposure_ms"] = self.exposures, self.exposures[0]
        if self.exposure == "file":
            if self.exposure_file is None:
                raise SettingError("--exposure file requires --exposure-file with one exposure per frame")
            options["exposures_ms"] = tuple(exposures_in(self.exposure_file)[: self.frames])
        if self.vignette_coefficients:
            options["vignette_coefficients"] = self.vignette_coefficients
        return SimulationSettings(**options)


command = declared("simulate")(_Simulation)
