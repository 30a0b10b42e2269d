"""Saves the state of a run while it goes on, and goes on from it after a crash, a kill or an interruption."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from ospc.errors import FormatError, SettingError
from ospc.pace import Pace
from ospc.state.container import STATE_NAME

if TYPE_CHECKING:
    from ospc.calibrator import OnlineCalibrator
    from ospc.pooling.prior_calibration import PriorCalibration

_LARGEST_SHARE = 0.02
"""Checkpoints may take so much of a run's time at most."""

_SAME = ("frames", "size", "frames_sha256", "images_sha256")


@dataclass
class Checkpoints:
    """Writes the state of one run into its output folder.

    It is written at most ``every_s`` seconds, or after every frame for 0; ``resume`` goes on from one that is there.
    ``prior`` is an earlier calibration of the camera. ``notes`` are for the user; ``saved`` says whether the final
    state was written.
    """

    folder: Path
    every_s: float = 5.0
    resume: bool = False
    prior: PriorCalibration | None = None
    notes: list[str] = field(default_factory=list)
    saved: bool = False
    _pace: Pace = field(init=False, repr=False)
    _failed: bool = field(default=False, repr=False)

    def __post_init__(self) -> None:
        """Set how often a state is saved."""
        self._pace = Pace(self.every_s, _LARGEST_SHARE if self.every_s else math.inf)

    @property
    def place(self) -> Path:
        """Path of the state."""
        return self.folder / STATE_NAME

    def resumed(self, calibrator: OnlineCalibrator) -> OnlineCalibrator:
        """Return a new calibrator as it is, or the one that goes on from the checkpoint.

        Parameters
        ----------
        calibrator
            New, with its settings and the identification of its recording.

        Raises
        ------
        FormatError
            If the checkpoint is torn, damaged or of another version.
        SettingError
            If it is of another recording or of other settings, or the method has none.
        """
        with self._pace.look():
            pass  # the first is due only after that time
        if not calibrator.settings.keeps_state:
            if self.resume:
                name = calibrator.settings.name
                raise SettingError(f"--resume: preset {name} has no checkpoints; leave --resume out")
            return calibrator
        if self.resume and self.place.exists():
            calibrator = self._loaded(calibrator)
        elif self.resume:
            self.notes.append(f"{self.folder} holds no checkpoint yet: starting with the first frame")
        calibrator.prior = self.prior
        return calibrator

    def after_frame(self, calibrator: OnlineCalibrator) -> None:
        """Save the state if it is time to."""
        if self._pace.due and calibrator.settings.keeps_state and not self._failed:
            with self._pace.look():
                self._save(calibrator, complete=False)

    def before_estimating(self, calibrator: OnlineCalibrator) -> None:
        """Save the state of a run that was interrupted: who gives up now loses no frame."""
        if calibrator.settings.keeps_state:
            self._save(calibrator, complete=False)

    def at_the_end(self, calibrator: OnlineCalibrator) -> None:
        """Save the final state, with the summary that it can be merged by; or remove one of an earlier run."""
        difference = None if self.prior is None else self.prior.difference(calibrator.summary())
        if self.prior is not None and difference is not None:
            self.notes.append(f"this is not the camera of {self.prior.name}: {difference.text}")
        if calibrator.settings.keeps_state:
            self._save(calibrator, complete=True)
            self.saved = not self._failed
        else:
            with suppress(OSError):
                self.place.unlink(missing_ok=True)

    def _save(self, calibrator: OnlineCalibrator, *, complete: bool) -> None:
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            calibrator.save_state(self.place, complete=complete)
        except (OSError, FormatError) as error:
            # Go on: the result matters more than being able to resume.
            self._failed = True
            self.notes.append(f"no state was saved: {error}")

    def _loaded(self, new: OnlineCalibrator) -> OnlineCalibrator:
        from ospc.calibrator import OnlineCalibrator
        from ospc.settings import as_dict
        from ospc.versions import versions

        found = OnlineCalibrator.load_state(self.place)
        start_anew = "leave out --resume to start anew"
        if [found.source.get(name) for name in _SAME] != [new.source.get(name) for name in _SAME]:
            name = found.source.get("name", "a live camera")
            raise SettingError(f"{self.place}: is the state of another recording ({name}); {start_anew}")
        if (found.settings, found.correct_lag) != (new.settings, new.correct_lag):
            before = as_dict(found.settings)
            changed = [
                f"{name} {before.get(name)} instead of {value}"
                for name, value in as_dict(new.settings).items()
                if before.get(name) != value
            ]
            if found.correct_lag != new.correct_lag:
                changed.append(f"--correct-lag {found.correct_lag} instead of {new.correct_lag}")
            raise SettingError(f"{self.place}: was made with other settings ({', '.join(changed)}); {start_anew}")
        self.notes.append(f"going on after frame {found.frames} from {self.place}")
        made = {name: version for name, version in found.saved_by.items() if versions().get(name) != version}
        if made:
            names = ", ".join(f"{name} {version}" for name, version in made.items())
            self.notes.append(f"the state was saved by {names}: the result may differ in the last digits")
        found.source = new.source
        return found
