"""The calibration of each condition: the recording's own truth, an estimate from it, or given files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from ospc.errors import FormatError, NotObservableError, SettingError
from ospc.formats.opening import Photometry, open_photometry
from ospc.recording import Recording
from ospc.recording.identity import identity
from ospc.research.method import Estimate, Method, run_methods
from ospc.research.odometry.conditions import Condition
from ospc.research.odometry.inputs import write_curves
from ospc.research.own_methods import OwnMethod
from ospc.research.rivals.bergmann import Bergmann
from ospc.research.source import PCALIB, true_curves
from ospc.research.store import key_of, made_with

_FROM_EXPOSURES = {"paper": "paper", "ours": "default"}
"""Conditions whose calibration is estimated with the exposures of the recording, and their presets."""

OnEstimate = Callable[[str, float], None]
"""Called with what is being estimated, and the share that is done."""


@dataclass(frozen=True)
class Calibrations:
    """Finds or estimates calibrations, and keeps the estimates in a folder.

    Those ``given``, by the name of their condition, are preferred to everything else. Joint estimation is ``online``,
    as in the paper's comparison, or from the whole recording.
    """

    folder: Path
    given: Mapping[str, Photometry] = field(default_factory=dict)
    online: bool = True
    progress: OnEstimate = lambda _what, _share: None

    def of(self, recording: Recording, condition: Condition) -> Photometry:
        """Return the calibration of a recording under a condition; an empty one where the condition has none."""
        if not condition.calibrated:
            return Photometry("none", None, None)
        if condition.name in self.given:
            return self.given[condition.name]
        if condition.name == "truth":
            return Photometry(str(recording.path), *true_curves(recording))
        if condition.name not in ("paper", "ours", "joint-wgt", "joint-wogt"):
            raise SettingError(f"there is no calibration '{condition.name}'; give it by {condition.name}=FILES")
        return open_photometry(self._estimated(recording, condition.name))

    def _estimated(self, recording: Recording, name: str) -> Path:
        """Return the folder of an estimate, made unless it is there; both joint variants are made at once."""
        joint = name not in _FROM_EXPOSURES
        depends_on = {"recording": identity(recording), "online": joint and self.online, "made_with": made_with()}
        place = self.folder / f"{recording.path.name or 'recording'}-{key_of(depends_on)[:16]}" / name
        if place.is_dir():
            return place
        estimates = self._joint(recording) if joint else self._from_exposures(recording, name)
        if name not in estimates:
            raise FormatError(f"{recording.path}: has no {PCALIB}, which holds the one known point of the response")
        for variant, estimate in estimates.items():
            try:
                _save(estimate, place.with_name(variant))
            except OSError as error:
                raise SettingError(f"{place}: cannot be written ({error.strerror}); choose another folder") from None
        return place

    def _from_exposures(self, recording: Recording, name: str) -> dict[str, Estimate]:
        found = self._found(recording, OwnMethod(_FROM_EXPOSURES[name], variant=name))
        if found[name].response is None:
            raise NotObservableError(f"{recording.path}: its exposures do not show the response")
        return found

    def _joint(self, recording: Recording) -> dict[str, Estimate]:
        truth = true_curves(recording)[0] if (recording.path / PCALIB).is_file() else None
        found = self._found(recording, Bergmann(truth, online=self.online))
        return {f"joint-{variant.rpartition('-')[2]}": estimate for variant, estimate in found.items()}

    def _found(self, recording: Recording, method: Method) -> dict[str, Estimate]:
        progress = partial(self.progress, f"calibrating {recording.path.name}")
        estimates: dict[str, Estimate] = {}
        for result in run_methods({"method": method}, recording, len(recording), progress):
            if isinstance(result.outcome, str):
                raise NotObservableError(f"{recording.path}: {result.outcome}")
            estimates[result.variant] = result.outcome
        return estimates


def _save(estimate: Estimate, place: Path) -> None:
    """Write an estimate into a folder, which appears when it is complete."""
    if place.is_dir():
        return
    place.parent.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=place.parent, prefix=".unfinished-") as name:
        unfinished = Path(name) / place.name
        unfinished.mkdir()
        if estimate.calibration is not None:
            estimate.calibration.save(unfinished / "calibration.json")
        else:
            write_curves(estimate, unfinished)
        unfinished.rename(place)
