"""The input of odometry: a recording in the layout of the monocular data set, with the files of one condition.

Conditions are the columns of the paper's table. The paper (section 4.2) runs DSO with the full ground truth, with its
own calibration (I), and with the calibration of Bergmann et al. 2018 aligned by one point of the true response (II)
or without that point ("II modified"), always with the exposures of the metadata. It also runs DSO without any
photometric calibration, "including the affine brightness correction", with all exposures set to one (III). This is
mode 2 of DSO, which fixes the affine brightness transfer at identity; mode 1, which leaves it free, is an additional
condition.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

import numpy as np

from ospc.arrays import FloatArray
from ospc.errors import FormatError, NotObservableError, RecordingError, SettingError, counted, named
from ospc.formats.dso import parameter_files, read_pcalib, write_times
from ospc.formats.opening import Photometry, open_photometry
from ospc.photometry.calibration import Calibration
from ospc.recording import Recording
from ospc.recording.recording import identity
from ospc.recording.writing.conversion import convert_recording
from ospc.research.method import Method, OwnMethod, run_methods
from ospc.research.rivals.bergmann import Bergmann
from ospc.research.runner import key_of, made_with
from ospc.research.source import PCALIB, fingerprints, true_curves
from ospc.system.folders import writing

Mode = Literal[0, 1, 2]
"""DSO's mode: 0 with calibration files, 1 with a free affine brightness transfer instead, 2 with neither."""

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.+-]{0,63}")


@dataclass(frozen=True)
class Condition:
    """A calibration condition: its name in commands and results, its column heading, and DSO's mode."""

    name: str
    title: str
    mode: Mode = 0

    @property
    def calibrated(self) -> bool:
        """Whether it needs a response and a vignette."""
        return self.mode == 0


STANDARD: tuple[Condition, ...] = (
    Condition("truth", "Full truth"),
    Condition("paper", "The paper's (I)"),
    Condition("ours", "Ours"),
    Condition("joint-wgt", "Joint, one true point (II)"),
    Condition("joint-wogt", "Joint, no truth (II modified)"),
    Condition("none", "None (III)", 2),
)
"""The columns of the paper's table, including its modified experiment II, and this project's method."""
AFFINE = Condition("affine", "None, affine transfer free", 1)
"""Not in the paper: the mode recommended for DSO without a calibration."""

_KNOWN = {condition.name: condition for condition in (*STANDARD, AFFINE)}


def external(name: str) -> Condition:
    """Return a condition for calibration files of another program, under a new name."""
    if not _NAME.fullmatch(name) or name in _KNOWN:
        raise SettingError(
            f"'{name}' cannot be the name of a calibration; choose another word of letters, digits and _ . + -"
        )
    return Condition(name, name)


def chosen(names: Sequence[str]) -> tuple[Condition, ...]:
    """Return standard conditions by name, in the order of the paper's table."""
    wanted = [named("condition", name, _KNOWN) for name in names]
    return tuple(condition for condition in _KNOWN.values() if condition in wanted)


CAMERA, TIMES, TRUTH = "camera.txt", "times.txt", "groundtruthSync.txt"
_NEEDED_FOR = {CAMERA: "odometry needs the camera's geometry", TRUTH: "trajectory errors need the ground truth"}
_SUFFIXES = (".png", ".jpg", ".jpeg")


@dataclass(frozen=True)
class OdometryInput:
    """The input of odometry: a recording's folder, which contains camera.txt, under a condition.

    ``images`` is a folder that contains only the images, one file per frame, in temporal order by name.
    """

    place: Path
    images: Path
    stamps_s: FloatArray = field(repr=False)
    exposures_ms: FloatArray = field(repr=False)
    condition: Condition
    photometry: Photometry
    recording_identity: dict[str, Any] = field(repr=False)

    @classmethod
    def of(cls, recording: Recording, images: Path, condition: Condition, photometry: Photometry) -> OdometryInput:
        """Return the input for a recording under a condition."""
        stamps, exposures = np.array([recording.stamps_s, recording.exposures_ms], dtype=np.float64)
        given = np.ones_like(exposures) if condition.mode == 2 else exposures
        known = identity(recording) | {"name": ""}
        return cls(recording.path, images, stamps, given, condition, photometry, known)

    def describe(self) -> dict[str, Any]:
        """Return what results depend on: recording, camera, mode, and a hash of each curve."""
        return {
            "recording": self.recording_identity,
            "camera": sha256(needed(self.place, CAMERA).read_bytes()).hexdigest(),
            "mode": self.condition.mode,
            **fingerprints(self.photometry),
        }

    @contextmanager
    def folder(self) -> Iterator[Path]:
        """Create a temporary folder with images (a link), times.txt, camera.txt and the condition's parameter files.

        Start programs in this folder and pass relative paths: DSO cuts a path at its first blank.
        """
        with TemporaryDirectory(prefix="ospc-odometry-") as name:
            place = Path(name)
            (place / "images").symlink_to(self.images.resolve(), target_is_directory=True)
            shutil.copyfile(needed(self.place, CAMERA), place / CAMERA)
            write_times(place / TIMES, range(len(self.stamps_s)), self.stamps_s, self.exposures_ms)
            for file, write in parameter_files(self.photometry.response, self.photometry.vignette, max_grey=255):
                write(place / file)
            yield place


def needed(place: Path, name: str) -> Path:
    """Return the path of camera.txt or groundtruthSync.txt in a recording's folder, which must have it."""
    if not (place / name).is_file():
        raise RecordingError(f"{place}: has no {name}; {_NEEDED_FOR[name]}")
    return place / name


def images_of(recording: Recording, cache: Path) -> Path:
    """Return a folder with a recording's images for odometry, one file per frame.

    This is the recording's own folder ``images`` if that contains exactly the frames; otherwise they are written
    below ``cache``.
    """
    own = recording.path / "images"
    if own.is_dir() and recording.max_grey == 255:
        entries = list(own.iterdir())
        if len(entries) == len(recording) and all(p.suffix.lower() in _SUFFIXES for p in entries):
            return own
    place = cache / f"images-{key_of(identity(recording))[:16]}"
    if (place / TIMES).is_file():
        return place / "images"
    made = convert_recording(recording, place, overwrite=True)
    if made.frames != len(recording):
        (place / TIMES).unlink()
        raise RecordingError(
            f"{recording.path}: {made.skipped} of {counted(len(recording), 'image')} cannot be read; odometry needs "
            f"all of them"
        )
    return place / "images"


_PRESETS = {"paper": "paper", "ours": "default"}
"""Presets of the conditions whose calibration uses the exposures of the recording."""


@dataclass(frozen=True)
class Calibrations:
    """Finds or estimates calibrations, and stores the estimates in a folder.

    Those ``given``, by the name of their condition, take precedence. Joint estimation is online, as in the paper's
    comparison. ``progress`` is called with a description of the estimation and the share that is done.
    """

    folder: Path
    given: Mapping[str, Photometry] = field(default_factory=dict)
    progress: Callable[[str, float], None] = lambda _what, _share: None

    def of(self, recording: Recording, condition: Condition) -> Photometry:
        """Return the calibration of a recording under a condition; empty if the condition has none."""
        if not condition.calibrated:
            return Photometry("none", None, None)
        if condition.name in self.given:
            return self.given[condition.name]
        if condition.name == "truth":
            return Photometry(str(recording.path), *true_curves(recording))
        if condition.name not in _KNOWN:
            raise SettingError(f"there is no calibration '{condition.name}'; give it as {condition.name}=FILES")
        return open_photometry(self._estimated(recording, condition.name))

    def _estimated(self, recording: Recording, name: str) -> Path:
        """Return the file of an estimate, and create it if needed; both joint variants are created together."""
        preset = _PRESETS.get(name)
        depends_on = {"recording": identity(recording), "preset": preset, "made_with": made_with()}
        folder = self.folder / f"{recording.path.name or 'recording'}-{key_of(depends_on)[:16]}"
        place = folder / f"{name}.json"
        if place.is_file():
            return place
        if preset is None:
            pcalib = recording.path / PCALIB
            truth = read_pcalib(pcalib) if pcalib.is_file() else None
            method: Method = Bergmann(truth, online=True)
        else:
            method = OwnMethod(preset, variant=name)
        progress = partial(self.progress, f"calibrating {recording.path.name}")
        for variant, found in run_methods({name: method}, recording, len(recording), progress).items():
            if isinstance(found, str):
                raise NotObservableError(f"{recording.path}: {found}")
            if found.response is None:
                raise NotObservableError(f"{recording.path}: its exposures do not show the response")
            with writing(folder):
                folder.mkdir(parents=True, exist_ok=True)
            known = found.calibration or Calibration(recording.size, found.response, found.vignette)
            known.save(folder / f"{variant.replace('joint-online', 'joint')}.json")
        if not place.is_file():
            raise FormatError(f"{recording.path}: has no {PCALIB}, which provides the known point of the response")
        return place
