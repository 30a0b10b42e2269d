"""Small versions of the recordings in the documentation's commands, created on demand."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner
from rosbags.rosbag2 import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from command_line import leave_out
from exif_segments import exif
from ospc.arrays import Image
from ospc.cli.main import cli
from ospc.recording import open_recording
from ospc.settings import DefaultSettings
from ospc.simulation import SimulationSettings, simulate

_SMALL = SimulationSettings(
    size=(256, 192),
    frames=10,
    exposure="sweep",
    exposure_min_ms=2.0,
    exposure_max_ms=24.0,
    response="srgb",
    speed=2.0,
    seed=1,
)

_MESSAGES = ("std_msgs/msg/Header", "builtin_interfaces/msg/Time", "sensor_msgs/msg/Image")

QUICK = replace(DefaultSettings(), points_per_pair=120, rounds=2, response_intervals=16, radial_terms=8)
"""The default preset with less computation; the documented behaviour is the same."""


def run_command(arguments: list[str], exit_codes: tuple[int, ...] = (0, 3)) -> str:
    """Run an ``ospc`` command in this process and return its standard output.

    The recordings are short, so calibrations may be marginal (exit code 3).
    """
    result = CliRunner().invoke(cli, arguments, prog_name="ospc")
    if result.exit_code not in exit_codes:
        why = f"{type(result.exception).__name__}: {result.exception}" if result.exception else ""
        raise AssertionError(
            f"ospc {' '.join(arguments)}: exit code {result.exit_code}, not {exit_codes}\n{result.output}\n{why}"
        )
    return result.stdout


@dataclass
class Stage:
    """A folder with all files that the pages mention, each created only once.

    Attributes
    ----------
    root
        The folder.
    """

    root: Path
    _made: set[str] = field(default_factory=set)

    def set_for(self, text: str, folder: Path) -> None:
        """Copy all files that a page mentions into a folder, where commands may modify them."""
        for name, make in MAKERS.items():
            if re.search(rf"\b{re.escape(name)}\b", text):
                self._ensure(name, make)
                for part in self.root.glob(f"{Path(name).stem}*"):
                    _copy(part, folder / part.name)

    def _ensure(self, name: str, make: Callable[[Stage, Path], None]) -> None:
        if name not in self._made:
            make(self, self.root / name)
            self._made.add(name)

    def recording(self) -> Path:
        self._ensure("my_recording", MAKERS["my_recording"])
        return self.root / "my_recording"


def _copy(part: Path, to: Path) -> None:
    if part.is_dir():
        shutil.copytree(part, to, dirs_exist_ok=True)
    else:
        shutil.copyfile(part, to)


def _simulated(**changes: object) -> Callable[[Stage, Path], None]:
    def make(_: Stage, to: Path) -> None:
        simulate(to, replace(_SMALL, **changes))  # type: ignore[arg-type]

    return make


def _calibrated(recording: str) -> Callable[[Stage, Path], None]:
    def make(stage: Stage, to: Path) -> None:
        stage._ensure(recording, MAKERS[recording])
        with pytest.MonkeyPatch.context() as patch:
            leave_out(patch, "draw", "report")
            run_command(["calibrate", str(stage.root / recording), "-o", str(to), "--quiet"])

    return make


def _frames(stage: Stage) -> list[tuple[Image, float]]:
    return [(frame.image, frame.exposure_ms) for frame in open_recording(stage.recording())]


def _video(stage: Stage, to: Path) -> None:
    frames = _frames(stage)
    height, width = frames[0][0].shape
    code = cv2.VideoWriter.fourcc(*"MJPG")
    writer = cv2.VideoWriter(str(to), cv2.CAP_FFMPEG, code, 20.0, (width, height))
    for image, _ in frames:
        writer.write(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR))
    writer.release()
    rows = "".join(f"{i / 20:.3f},{ms * 1000:.1f},1.0\n" for i, (_, ms) in enumerate(frames))
    to.with_suffix(".csv").write_text(f"timestamp_s,exposure_us,gain\n{rows}")


def _bag(stage: Stage, to: Path) -> None:
    """Write a bag like that of the RealSense node: images on one topic, their metadata as text on another."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    kind = "realsense2_camera_msgs/msg/Metadata"
    store.register(get_types_from_msg("std_msgs/Header header\nstring json_data\n", kind))
    header, stamp, image = (store.types[name] for name in _MESSAGES)
    with Writer(to, version=9) as writer:
        images = writer.add_connection("/camera/infra1/image_rect_raw", _MESSAGES[2], typestore=store)
        texts = writer.add_connection("/camera/infra1/metadata", kind, typestore=store)
        for i, (grey, ms) in enumerate(_frames(stage)):
            ns = 1_700_000_000_000_000_000 + i * 50_000_000
            head = header(stamp(ns // 10**9, ns % 10**9), "camera")
            height, width = grey.shape
            message = image(head, height, width, "mono8", 0, width, grey.ravel())
            metadata = store.types[kind](head, json.dumps({"actual_exposure": ms * 1000, "gain_level": 16}))
            writer.write(images, ns, store.serialize_cdr(message, _MESSAGES[2]))
            writer.write(texts, ns, store.serialize_cdr(metadata, kind))


def _listed_images(stage: Stage, to: Path) -> None:
    to.mkdir()
    rows = ["file,timestamp_s,exposure_us,gain_db"]
    for i, (image, ms) in enumerate(_frames(stage)):
        cv2.imwrite(str(to / f"{i:04d}.png"), image)
        rows.append(f"{i:04d}.png,{i / 20:.3f},{ms * 1000:.1f},0")
    (to / "exposures.csv").write_text("\n".join(rows) + "\n")


def _photographs(stage: Stage, to: Path) -> None:
    to.mkdir()
    for i, (image, ms) in enumerate(_frames(stage)[::2]):
        jpeg = cv2.imencode(".jpg", image)[1].tobytes()
        segment = exif(time=(round(ms * 1000), 10**6), taken=f"2025:06:01 12:00:{i:02d}")
        (to / f"DSC_{i:04d}.JPG").write_bytes(jpeg[:2] + segment + jpeg[2:])


def _brackets(_: Stage, to: Path) -> None:
    made = simulate(
        to.with_name("all_of_the_brackets"),
        replace(_SMALL, frames=10, motion="static", exposure="cycle", exposures_ms=(1.0, 2.0, 4.0, 8.0, 16.0)),
    )
    for i, frame in enumerate(open_recording(made.path)):
        folder = to / f"{frame.exposure_ms:g}ms"
        folder.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(folder / f"{1_700_000_000 + i}.png"), frame.image)


def _broken_files(_: Stage, to: Path) -> None:
    to.mkdir()
    values = np.linspace(0, 255, 256)
    values[250:] = 250.0
    (to / "pcalib.txt").write_text(" ".join(f"{v:.3f}" for v in values) + "\n")


MAKERS: dict[str, Callable[[Stage, Path], None]] = {
    "my_recording": _simulated(),
    "my_camera": _calibrated("my_recording"),
    "second_recording": _simulated(seed=2, scene_seed=1),
    "other_camera": _calibrated("second_recording"),
    "late_recording": _simulated(exposure="auto", lag=1, seed=3, scene_seed=1),
    "tripod_series": _simulated(motion="static"),
    "brackets": _brackets,
    "constant_exposure": _simulated(exposure="constant", exposures_ms=(8.0,)),
    "webcam.avi": _video,
    "robot_bag": _bag,
    "listed_images": _listed_images,
    "photographs": _photographs,
    "somebodys_files": _broken_files,
}
"""Functions that create the files that pages mention, by name. Files with the same stem belong together."""
