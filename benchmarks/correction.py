"""What correcting costs: one image against OpenCV's own look-up and product, a recording against reading and writing.

    python benchmarks/correction.py [--frames N]

Prints ratios of medians, taken in turns in one run: never a bare second.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from ospc.correction.folder import CorrectedFolder
from ospc.correction.recording import correct_recording
from ospc.correction.settings import CorrectionSettings
from ospc.correction.threads import mapped
from ospc.formats.opening import open_photometry
from ospc.photometry.correction import Corrector, look_up
from ospc.photometry.response import Response
from ospc.photometry.vignette import PolynomialVignette
from ospc.recording import open_recording
from ospc.simulation import SimulationSettings, simulate

SIZE = (1280, 1024)


def medians(contenders: dict[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Return the median time of each, all called in turns."""
    times: dict[str, list[float]] = {name: [] for name in contenders}
    for _ in range(rounds + 1):
        for name, call in contenders.items():
            begin = time.perf_counter()
            call()
            times[name].append(time.perf_counter() - begin)
    return {name: float(np.median(values[1:])) for name, values in times.items()}


def floor(image: np.ndarray, table: np.ndarray, inverse: np.ndarray, depth: int) -> np.ndarray:
    """Return a look-up and a product, with nothing around them."""
    return cv2.multiply(look_up(image, table), inverse, dtype=depth)


def one_image() -> None:
    """Compare the correction of an image with its floor, on one thread."""
    cv2.setNumThreads(1)
    random = np.random.default_rng(0)
    smooth = cv2.GaussianBlur(random.random(SIZE[::-1]), (0, 0), 20)
    smooth = (smooth - smooth.min()) / np.ptp(smooth)
    vignette = PolynomialVignette(SIZE, (-0.35, 0.05, -0.15))
    for bits in (8, 16):
        limit = 2**bits - 1
        grey = np.rint(smooth * limit).astype(np.uint8 if bits == 8 else np.uint16)
        corrector = Corrector(Response.gamma(2.2), vignette, limit)
        table = (np.linspace(0, 1, limit + 1) ** 2.2).astype(np.float32)[:, None]
        for image in (grey, np.stack([grey] * 3, axis=-1)):
            inverse = 1 / vignette.image()
            inverse = inverse if image.ndim == 2 else np.repeat(inverse[:, :, None], 3, axis=2)
            for dtype, depth in ((np.float32, cv2.CV_32F), (np.uint8, cv2.CV_8U), (np.uint16, cv2.CV_16U)):
                scale = np.float32(1 if dtype == np.float32 else np.iinfo(dtype).max)
                found = medians(
                    {
                        "floor": partial(floor, image, table * scale, inverse, depth),
                        "correct": partial(corrector.correct, image, 5.0, dtype=dtype),
                    },
                    40,
                )
                kind = "grey" if image.ndim == 2 else "colour"
                ratio = found["correct"] / found["floor"]
                print(f"image   {bits:2} bit {kind:6} → {np.dtype(dtype).name:8} {ratio:5.2f} × look-up and product")


def recording(frames: int) -> None:
    """Compare the correction of a recording with reading its images and writing the same files."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for form in ("png", "jpg"):
            settings = SimulationSettings(size=SIZE, frames=frames, image_format=form, exposure="sweep")
            simulate(folder / form, settings)
            for output in ("irradiance", "grey8", "grey16"):
                compare_with_copying(folder, folder / form, CorrectionSettings(output=output))


def compare_with_copying(folder: Path, source: Path, settings: CorrectionSettings) -> None:
    """Compare one kind of output."""
    opened, photometry = open_recording(source), open_photometry(source)
    out = folder / f"{source.name}-{settings.output}"
    corrected = CorrectedFolder.at(out, source)
    correct_recording(opened, photometry, corrected, settings)
    files = sorted((out / "images").iterdir())
    images = [cv2.imread(str(file), cv2.IMREAD_UNCHANGED) for file in files]
    copied = CorrectedFolder.at(folder / f"{out.name}-copied", source)
    copied.begin({})

    def read_and_write(threads: bool) -> None:
        frames = ((frame.index, frame.image) for frame in opened)

        def write(item: tuple[int, np.ndarray]) -> None:
            copied.write_image(item[0], images[item[0]])

        for _ in mapped(write, frames) if threads else map(write, frames):
            pass

    found = medians(
        {
            "correct": partial(correct_recording, opened, photometry, corrected, settings),
            "threads": partial(read_and_write, True),
            "loop": partial(read_and_write, False),
        },
        5,
    )
    one, other = found["correct"] / found["loop"], found["correct"] / found["threads"]
    print(
        f"folder  {source.name} → {settings.output:10} {one:5.2f} × reading and writing the same files one by one, "
        f"{other:5.2f} × doing so in the same threads"
    )
    for file in (*files, *(copied.path / "images").iterdir()):
        file.unlink(missing_ok=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=30)
    one_image()
    recording(parser.parse_args().frames)
