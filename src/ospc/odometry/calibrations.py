"""The calibration that each condition runs with: the recording's own truth, estimates made here, or given files."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ospc.atomic import write_atomically
from ospc.baselines.joint import JointEstimate, calibrate_jointly
from ospc.calibrator import OnlineCalibrator
from ospc.errors import FormatError, NotObservableError, SettingError
from ospc.formats.dso import write_pcalib, write_vignette
from ospc.formats.opening import Photometry, open_photometry
from ospc.odometry.conditions import Condition
from ospc.odometry.inputs import PCALIB, VIGNETTE
from ospc.recording import Recording
from ospc.recording.identity import identity

_SOURCE = "source.json"
_SCHEMA = "ospc-odometry-calibration/1"

OnProgress = Callable[[str, int, int], None]
"""Told what is estimated, how many frames are done, and of how many."""


@dataclass(frozen=True)
class Calibrations:
    """Finds or makes calibrations, and keeps in a folder those it made.

    Attributes
    ----------
    folder
        Where; made when needed.
    given
        Calibrations of other programs, by the name of their condition; they go before everything else.
    online
        Whether joint estimation is the online variant that the paper compares with, or the batch variant.
    progress
        Told how far an estimate is.
    """

    folder: Path
    given: Mapping[str, Photometry] = field(default_factory=dict)
    online: bool = True
    progress: OnProgress = lambda _what, _done, _total: None
    _joint_estimates: dict[Path, JointEstimate] = field(default_factory=dict, init=False, repr=False)

    def of(self, recording: Recording, condition: Condition) -> Photometry | None:
        """Return the calibration of a recording under a condition; None where the condition has none.

        Raises
        ------
        OspcError
            If it cannot be read or estimated.
        """
        if not condition.calibrated:
            return None
        if condition.name in self.given:
            return self.given[condition.name]
        if condition.name == "truth":
            return true_photometry(recording)
        makers = {"ours": self._ours, "joint-wgt": self._joint, "joint-wogt": self._joint}
        if condition.name not in makers:
            raise SettingError(f"there is no calibration '{condition.name}'; give it by {condition.name}=FILES")
        return self._kept(recording, condition.name, makers[condition.name])

    def _kept(self, recording: Recording, name: str, make: Callable[[Recording, str, Path], None]) -> Photometry:
        source = {"schema": _SCHEMA, "recording": identity(recording), "online": self.online and name != "ours"}
        place = self.folder / (recording.path.name or "recording") / name
        if _noted(place) != source:
            try:
                place.mkdir(parents=True, exist_ok=True)
                (place / _SOURCE).unlink(missing_ok=True)
                make(recording, name, place)
                write_atomically(place / _SOURCE, json.dumps(source, indent=1).encode())
            except OSError as error:
                raise SettingError(f"{place}: cannot be written ({error.strerror}); choose another folder") from None
        return open_photometry(place)

    def _ours(self, recording: Recording, name: str, place: Path) -> None:
        calibrator = OnlineCalibrator()
        for done, frame in enumerate(recording, start=1):
            calibrator.push(frame)
            self.progress(f"{recording.path.name}: {name}", done, len(recording))
        calibration = calibrator.calibration()
        if calibration.response is None:
            raise NotObservableError(f"{recording.path}: its exposures do not show the response")
        calibration.save(place / "calibration.json")

    def _joint(self, recording: Recording, name: str, place: Path) -> None:
        """Estimate once for both variants, which differ by an exponent only."""
        if recording.path not in self._joint_estimates:
            self._joint_estimates[recording.path] = calibrate_jointly(
                recording,
                online=self.online,
                progress=lambda done: self.progress(f"{recording.path.name}: joint", done, len(recording)),
            )
        found = self._joint_estimates[recording.path]
        if name == "joint-wgt":
            response = true_photometry(recording).response
            if response is None:
                raise FormatError(
                    f"{recording.path}: has no {PCALIB} to take the one known point of the response from"
                )
            found = found.aligned_to(response)
        write_pcalib(found.response, place / PCALIB)
        write_vignette(found.vignette, place / VIGNETTE)


def true_photometry(recording: Recording) -> Photometry:
    """Return the true response and vignette that lie in a recording's folder.

    Raises
    ------
    FormatError
        If there are none, or they cannot be read.
    """
    table, picture = recording.path / PCALIB, recording.path / VIGNETTE
    if not table.is_file() or not picture.is_file():
        raise FormatError(
            f"{recording.path}: has no {PCALIB} and {VIGNETTE} to take the truth from; give truth=FILES"
        )
    return Photometry(str(recording.path), open_photometry(table).response, open_photometry(picture).vignette)


def _noted(place: Path) -> Any:
    try:
        return json.loads((place / _SOURCE).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
