"""Saves the state of a run while it goes on, and goes on from it after a crash, a kill or an interruption."""

from __future__ import annotations

import math
from contextlib import suppress
from pathlib import Path

from ospc.calibrator import OnlineCalibrator
from ospc.errors import FormatError, SettingError
from ospc.pace import Pace
from ospc.pooling.prior_calibration import PriorCalibration
from ospc.settings import as_dict
from ospc.state.container import STATE_NAME
from ospc.versions import versions

_LARGEST_SHARE = 0.02
"""Checkpoints may take so much of a run's time at most."""

_SAME = ("frames", "size", "frames_sha256", "images_sha256")


class Checkpoints:
    """Writes the state of one run into its output folder, if it is ``wanted`` and the method has one.

    It is written at most every ``every_s`` seconds, or after every frame for 0; ``resume`` goes on from one that is
    there. ``prior`` is an earlier calibration of the camera. ``notes`` are for the user; ``saved`` says whether the
    final state was written.
    """

    def __init__(
        self,
        folder: Path,
        every_s: float = 5.0,
        *,
        resume: bool = False,
        prior: PriorCalibration | None = None,
        wanted: bool = True,
    ) -> None:
        self.place = folder / STATE_NAME
        self.notes: list[str] = []
        self.saved = False
        self._resume, self._prior, self._kept = resume, prior, wanted
        self._pace = Pace(every_s, _LARGEST_SHARE if every_s else math.inf)
        self._failed = False

    def resumed(self, calibrator: OnlineCalibrator) -> OnlineCalibrator:
        """Return a new calibrator with its settings and source as it is, or one that goes on from the checkpoint.

        FormatError if that is damaged, SettingError if it is of another recording or of other settings.
        """
        with self._pace.look():
            pass  # the first is due only after that time
        self._kept = self._kept and calibrator.settings.keeps_state
        if not self._kept:
            if self._resume:
                name = calibrator.settings.name
                raise SettingError(f"--resume: preset {name} has no checkpoints; leave --resume out")
            return calibrator
        if self._resume and self.place.exists():
            calibrator = self._loaded(calibrator)
        elif self._resume:
            self.notes.append(f"{self.place.parent} holds no checkpoint yet: starting with the first frame")
        calibrator.prior = self._prior
        return calibrator

    def after_frame(self, calibrator: OnlineCalibrator) -> None:
        """Save the state if it is time to."""
        if self._pace.due and not self._failed:
            with self._pace.look():
                self._save(calibrator)

    def before_estimating(self, calibrator: OnlineCalibrator) -> None:
        """Save the state of a run that was interrupted: who gives up now loses no frame."""
        self._save(calibrator)

    def at_the_end(self, calibrator: OnlineCalibrator) -> None:
        """Save the final state, with the summary that it can be merged by; or remove one of an earlier run."""
        difference = None if self._prior is None else self._prior.difference(calibrator.summary())
        if self._prior is not None and difference is not None:
            self.notes.append(f"this is not the camera of {self._prior.name}: {difference.text}")
        self._save(calibrator, complete=True)
        self.saved = self._kept and not self._failed
        if not self._kept:
            with suppress(OSError):
                self.place.unlink(missing_ok=True)

    def _save(self, calibrator: OnlineCalibrator, *, complete: bool = False) -> None:
        if not self._kept:
            return
        try:
            self.place.parent.mkdir(parents=True, exist_ok=True)
            calibrator.save_state(self.place, complete=complete)
        except (OSError, FormatError) as error:
            # Go on: the result matters more than being able to resume.
            self._failed = True
            self.notes.append(f"no state was saved: {error}")

    def _loaded(self, new: OnlineCalibrator) -> OnlineCalibrator:
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
