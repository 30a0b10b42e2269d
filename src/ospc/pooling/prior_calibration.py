"""Start a calibration from an earlier one of the same camera, and detect whether the camera has changed since."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from ospc.arrays import ByValue, ImageSize
from ospc.errors import FormatError, NotObservableError, SettingError, path_of
from ospc.methods.identifiability import doubted
from ospc.photometry.calibration import Calibration
from ospc.pooling.agreement import Difference, agreement, difference_of
from ospc.pooling.calibration_summary import summary_of_calibration
from ospc.pooling.pool import Pool, agreeing, merge, usable_radius, why_unlike
from ospc.pooling.solution import Information, solve
from ospc.pooling.summary import RESPONSE_PART, VIGNETTE_PART, Summary, joint_range, triangle_of
from ospc.settings import Settings
from ospc.state.container import STATE_NAME


@dataclass(frozen=True, eq=False)
class PriorCalibration(ByValue):
    """An earlier calibration of a camera: its name in messages and its recordings; create one with :meth:`open`."""

    name: str
    pool: Pool

    @classmethod
    def open(cls, path: str | Path) -> PriorCalibration:
        """Read an earlier calibration: a ``state.ospc``, possibly merged, or a ``calibration.json``.

        The path may be a folder with one of these files. A ``calibration.json`` must be from the default method.

        Raises
        ------
        FormatError
            If it is none of these, or damaged.
        NotObservableError
            If it contains neither response nor vignette, or no majority of its recordings agrees, or if its exposures
            were unknown.
        """
        place = path_of(path, FormatError, "a calibration")
        if place.is_dir():
            place = place / (STATE_NAME if (place / STATE_NAME).is_file() else "calibration.json")
        if place.suffix == ".json":
            calibration = Calibration.load(place)
            if calibration.caveat:
                # Its covariance does not include the exponent.
                raise NotObservableError(
                    f"{path}: is not from known exposures, so its exponent is uncertain; start from a calibration "
                    "with known exposures"
                )
            return cls.of(calibration, str(path))
        found = cls(str(path), Pool.load(place))
        if found.summary is None:
            raise NotObservableError(
                f"{path}: its recordings contradict each other, so there is nothing to start from; merge only "
                "recordings of one unchanged camera"
            )
        return found

    @classmethod
    def of(cls, calibration: Calibration, name: str) -> PriorCalibration:
        """Return a calibration of the default method as an earlier one.

        Raises
        ------
        FormatError
            If it is not from the default method.
        NotObservableError
            If it contains neither response nor vignette.
        """
        return cls(name, Pool.of([summary_of_calibration(calibration, name)]))

    @cached_property
    def summary(self) -> Summary | None:
        """Joint summary of the recordings that agree, as if they were one recording; None without a majority."""
        agreed = agreement(self.pool.summaries)
        used = agreeing(self.pool, agreed)
        if not used:
            return None
        information = Information.of(used, usable_radius(used))
        fit = solve(information)
        return replace(
            used[0],
            key="earlier",
            name=self.name,
            frames=sum(s.frames for s in used),
            pairs=sum(s.pairs for s in used),
            points=information.points,
            groups=information.groups,
            estimate=fit.parameters,
            triangle=triangle_of(information.matrix),
            vector=information.vector,
            systematic=triangle_of(information.systematic),
            exposure_range_ms=joint_range(s.exposure_range_ms for s in used),
            radial_motion=max(s.radial_motion for s in used),
            stationary=all(s.stationary for s in used),
            support=joint_range(s.support for s in used),
            unexplained=float(np.median([s.unexplained for s in used])),
            usable_radius=information.usable_radius,
            measured_radius=information.measured_radius,
            vignette_reach=information.vignette_reach,
        )

    def check_method(self, settings: Settings) -> None:
        """Check that runs with these settings can be combined with an earlier calibration.

        Raises
        ------
        SettingError
            If the method has no state that could be merged.
        """
        if settings.state_type() is None:
            raise SettingError(
                f"preset {settings.name} cannot start from an earlier calibration ({self.name}); use the default one"
            )

    def check_size(self, size: ImageSize) -> None:
        """Check the size of frames.

        Raises
        ------
        SettingError
            If it differs from that of the earlier calibration.
        """
        if other := self._other_size(size):
            raise SettingError(f"{self.name}: {other}; start from a calibration of the same size")

    def _other_size(self, size: ImageSize) -> str:
        """Return how the size of frames differs; empty if it is the same."""
        if size == self.pool.size:
            return ""
        width, height = self.pool.size
        return f"it is for {width}×{height} pixels, but the frames have {size[0]}×{size[1]}"

    def _apart_from(self, today: Summary | None) -> Summary | None:
        """Return the joint summary without today's recording, which must not count twice; None if there is none."""
        others = tuple(s for s in self.pool.summaries if today is None or s.key != today.key)
        return self.summary if len(others) == len(self.pool) else PriorCalibration(self.name, Pool(others)).summary

    def continued(self, own: Calibration, today: Summary | None) -> Calibration:
        """Return the calibration from the earlier recordings and today's together.

        If the camera has changed since, the calibration is from today's frames alone, and the verdicts of the changed
        parts and ``source["started_from"]`` say so. Today's recording counts once, even if the earlier calibration
        already includes it. Warnings about today's frames limit all verdicts to marginal, however much was known
        before. So do frames that do not show by themselves that a part is still as it was.

        Parameters
        ----------
        own
            The calibration from today's frames alone.
        today
            The summary of today's frames; None if they allow no fit.
        """
        earlier = self._apart_from(today)
        unlike = self._other_size(own.size)
        if not unlike and earlier is not None and today is not None:
            unlike = why_unlike(earlier, today)
        difference = None if unlike else difference_of(today, earlier)
        changed, text = ([], "") if difference is None else (list(difference.parts), difference.text)
        own = replace(
            own, source=own.source | {"started_from": {"name": self.name, "changed": changed, "text": text}}
        )
        if earlier is None or unlike:
            same = "it is from this same recording, which must not count twice"
            reason = f"{unlike}, so it is from another camera or mode" if unlike else same
            return replace(own, notes=(*own.notes, f"{self.name} was not used: {reason}"))
        if difference is not None:
            return self._contradicted(own, difference)
        return self._together(own, earlier, today)

    def _contradicted(self, own: Calibration, difference: Difference) -> Calibration:
        """Return today's calibration with verdicts that say what has changed."""
        verdicts = dict(own.verdicts)
        for part in difference.parts:
            reason = f"{verdicts[part].reason}; it has changed since {self.name}: {difference.text}"
            verdicts[part] = replace(verdicts[part], reason=reason)
        note = f"the camera has changed since {self.name}: {difference.text}"
        return replace(own, verdicts=verdicts, notes=(*own.notes, note))

    def _together(self, own: Calibration, earlier: Summary, today: Summary | None) -> Calibration:
        """Return the calibration from the earlier recordings and today's."""
        pool = Pool.of([earlier] if today is None else [earlier, today])
        together = merge(pool, counts_recordings=False).calibration
        verdicts = dict(own.verdicts)
        for name, verdict in together.verdicts.items():
            begins = _knows(earlier, name)
            if today is None and not begins:
                continue
            alone = own.verdicts[name]
            reason = f"{verdict.reason}, starting from {self.name}" if begins else verdict.reason
            doubts = tuple((what, alone.remedy) for what in own.warnings)
            if begins and alone.state != "identifiable":
                doubts += ((f"the new frames do not check it ({alone.reason})", alone.remedy),)
            verdicts[name] = doubted(replace(verdict, reason=reason), doubts)
        return replace(
            own,
            response=together.response,
            vignette=together.vignette,
            vignette_sigma=together.vignette_sigma,
            verdicts=verdicts,
            covariance=together.covariance,
            converged=all(verdicts[name].state == "identifiable" for name in together.verdicts) and not own.warnings,
            advice=(
                *(verdicts[name].remedy for name in together.verdicts if verdicts[name].remedy),
                *(() if own.coverage is None else own.coverage.gaps(own.max_grey, earlier.grey_range)),
            ),
        )


def _knows(summary: Summary, part: str) -> bool:
    """Return whether a summary has any information about the response or the vignette."""
    inside = RESPONSE_PART if part == "response" else VIGNETTE_PART
    return bool(np.any(summary.matrix[inside, inside]))
