"""Start a calibration from an earlier one of the same camera, and detect whether the camera has changed since."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ospc.arrays import FloatArray
from ospc.errors import FormatError, NotObservableError, SettingError
from ospc.estimation.prior import START, Prior, vignette_precision
from ospc.estimation.vignette_basis import VignetteBasis
from ospc.methods.identifiability import judged
from ospc.photometry.calibration import Calibration
from ospc.photometry.grey_range import GreyRange
from ospc.photometry.noise import NoiseModel
from ospc.photometry.vignette import LogSplineVignette, Vignette
from ospc.pooling.agreement import Difference, agreement, difference_of
from ospc.pooling.pool import Pool, agreeing, merge, usable_radius
from ospc.pooling.solution import Information, solve
from ospc.pooling.summary import (
    PARAMETERS,
    RESPONSE,
    RESPONSE_PART,
    VIGNETTE,
    VIGNETTE_PART,
    Summary,
    joint_range,
    recording_key,
    triangle_of,
)
from ospc.settings.estimation import VIGNETTE_REACH
from ospc.state.container import STATE_NAME

_LEAST_INFORMATION = 1e-9
"""Smallest relative information in any direction: subtracting a prior may otherwise make it negative by rounding."""

_LEAST_OBSERVED = 0.05
"""Information on a direction of the vignette, relative to that of the prior, below which it counts as unobserved:
rounding and disagreement between halves would otherwise look like an observation that contradicts the prior."""

_GIVEN_UP_SIGMA = 0.005
"""Standard deviation, around zero, of vignette parameters that a calibration omits: it would have included larger
ones."""

_STEEPEST, _ROUGHEST = 1e3, 1e3
"""Largest accepted coefficients of a response and hyperparameters of its prior: a hundred times those of any fit."""

_USUAL_NOISE = NoiseModel((0.5 / 255) ** 2, 0.0)
"""Noise assumed if a calibration states none: half an 8-bit grey level, typical of a good camera."""


@dataclass(frozen=True)
class PriorCalibration:
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
            If it contains neither response nor vignette, or no majority of its recordings agrees.
        """
        place = Path(path)
        if place.is_dir():
            place = place / (STATE_NAME if (place / STATE_NAME).exists() else "calibration.json")
        if place.suffix == ".json":
            return cls.of(Calibration.load(place), str(path))
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
        if not (used and agreed.majority["response"]):
            return None
        information = Information.of(used, usable_radius(used)).weakened(agreed.scatter)
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
            reach=max(s.reach for s in used),
            standing_still=all(s.standing_still for s in used),
            support=joint_range(s.support for s in used),
            unexplained=float(np.median([s.unexplained for s in used])),
            usable_radius=information.usable_radius,
        )

    def check_size(self, size: tuple[int, int]) -> None:
        """Check the size of frames.

        Raises
        ------
        SettingError
            If it differs from that of the earlier calibration.
        """
        if size != self.pool.size:
            raise SettingError(
                f"{self.name}: is for {self.pool.size[0]}×{self.pool.size[1]} pixels, but the frames have "
                f"{size[0]}×{size[1]}; start from a calibration of the same size"
            )

    def difference(self, today: Summary | None) -> Difference | None:
        """Return how today's recording differs from the earlier ones; None if it does not."""
        return difference_of(today, self._apart_from(today))

    def _apart_from(self, today: Summary | None) -> Summary | None:
        """Return the joint summary without today's recording, which must not count twice; None if there is none."""
        others = tuple(s for s in self.pool.summaries if today is None or s.key != today.key)
        return self.summary if len(others) == len(self.pool) else PriorCalibration(self.name, Pool(others)).summary

    def continued(self, own: Calibration, today: Summary | None) -> Calibration:
        """Return the calibration from the earlier recordings and today's together.

        If the camera has changed since, the calibration is from today's frames alone, and the verdicts of the changed
        parts and ``source["started_from"]`` say so. Today's recording counts once, even if the earlier calibration
        already includes it. Warnings about today's frames limit all verdicts to marginal, however much was known
        before.

        Parameters
        ----------
        own
            The calibration from today's frames alone.
        today
            The summary of today's frames; None if they allow no fit.

        Raises
        ------
        SettingError
            If the size of the frames differs from that of the earlier calibration.
        """
        self.check_size(own.size)
        earlier = self._apart_from(today)
        difference = difference_of(today, earlier)
        changed, text = ([], "") if difference is None else (list(difference.parts), difference.text)
        source = own.source | {"started_from": {"name": self.name, "changed": changed, "text": text}}
        if earlier is None:
            note = f"{self.name} was not used: it is from this same recording, which must not count twice"
            return replace(own, source=source, notes=(*own.notes, note))
        verdicts = dict(own.verdicts)
        if difference is not None:
            for part in difference.parts:
                reason = f"{verdicts[part].reason}; it has changed since {self.name}: {text}"
                verdicts[part] = replace(verdicts[part], reason=reason)
            return replace(own, source=source, verdicts=verdicts)
        together = merge(Pool.of([earlier] if today is None else [earlier, today])).calibration
        for name, verdict in together.verdicts.items():
            begins = _knows(earlier, name)
            if today is None and not begins:
                continue
            # Merging ends a reason with the number of recordings.
            reason = f"{verdict.reason.rsplit(', from ', 1)[0]}{f', starting from {self.name}' if begins else ''}"
            doubts = tuple((what, own.verdicts[name].remedy) for what in own.warnings)
            verdicts[name] = judged(replace(verdict, reason=reason), doubts)
        return replace(
            own,
            response=together.response,
            vignette=together.vignette,
            vignette_sigma=together.vignette_sigma,
            verdicts=verdicts,
            covariance=together.covariance,
            converged=together.converged and not own.warnings,
            advice=(
                *(verdicts[name].remedy for name in together.verdicts if verdicts[name].remedy),
                *(() if own.coverage is None else own.coverage.gaps(own.max_grey)),
            ),
            source=source,
        )


def _knows(summary: Summary, part: str) -> bool:
    """Return whether a summary has any information about the response or the vignette."""
    inside = RESPONSE_PART if part == "response" else VIGNETTE_PART
    return bool(np.any(summary.matrix[inside, inside]))


def summary_of_calibration(calibration: Calibration, name: str) -> Summary:
    """Return a calibration as a summary: the information in its covariance minus that of the prior.

    Raises
    ------
    NotObservableError
        If it contains neither response nor vignette.
    FormatError
        If it is not from the default method.
    """
    if calibration.response is None and calibration.vignette is None:
        raise NotObservableError(f"{name}: has neither response nor vignette, so there is nothing to start from")
    try:
        found = _summary_of(calibration, name)
        found.check()
    except (LookupError, TypeError, ValueError, ArithmeticError, FormatError, np.linalg.LinAlgError):
        raise FormatError(
            f"{name}: is not a calibration of the default method with a covariance; start from a state.ospc instead"
        ) from None
    return found


def _summary_of(calibration: Calibration, name: str) -> Summary:
    matrix, vector = np.zeros((PARAMETERS, PARAMETERS)), np.zeros(PARAMETERS)
    estimate = np.concatenate([1 + RESPONSE.knots, np.zeros(len(VIGNETTE))])
    for known, part, information_of in (
        (calibration.response, RESPONSE_PART, _of_response),
        (calibration.vignette, VIGNETTE_PART, _of_vignette),
    ):
        if known is not None:
            estimate[part], matrix[part, part], vector[part] = information_of(calibration)
    range_ms = calibration.source.get("exposure_range_ms") or (1.0, np.e)
    return Summary(
        key=recording_key(f"calibration {name}", calibration.source),
        name=name,
        size=calibration.size,
        max_grey=calibration.max_grey,
        frames=int(calibration.counts.get("frames", 0)),
        pairs=int(calibration.counts.get("pairs", 0)),
        points=int(calibration.counts.get("samples", 1)),
        groups=int(calibration.counts.get("pairs", 1)),
        estimate=estimate,
        triangle=triangle_of(matrix),
        vector=vector,
        systematic=np.zeros_like(triangle_of(matrix)),
        exposure_range_ms=(float(range_ms[0]), float(range_ms[1])),
        reach=1.0 if calibration.vignette is not None else 0.0,
        standing_still=calibration.vignette is None,
        support=(0.0, 1.0) if calibration.response is None else calibration.response.support,
        unexplained=0.0,
        noise=calibration.noise or _USUAL_NOISE,
        grey_range=GreyRange(*(float(level) for level in _response_model(calibration).get("grey_range", (0.0, 1.0)))),
        usable_radius=_usable_radius(calibration.vignette),
        measured_radius=float(calibration.covariance.get("vignette", {}).get("measured_radius", 1.0)),
    )


def _response_model(calibration: Calibration) -> dict[str, Any]:
    return calibration.response.model if calibration.response is not None else {}


def _usable_radius(vignette: Vignette | None) -> float:
    """Return the usable radius of the image to which a vignette was fitted."""
    return min(1.0, vignette.reach / VIGNETTE_REACH) if isinstance(vignette, LogSplineVignette) else 1.0


def _of_response(calibration: Calibration) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the estimated response parameters, and A and b of their likelihood."""
    model = _response_model(calibration)
    coefficients = np.array(model["coefficients"], dtype=np.float64)
    covariance = np.array(calibration.covariance["response"]["matrix"], dtype=np.float64)
    if coefficients.shape != (len(RESPONSE),) or covariance.shape != (len(RESPONSE), len(RESPONSE)):
        raise ValueError("another number of knots")
    prior = Prior(RESPONSE.knots, coefficients, VignetteBasis(0), np.empty(0))
    hyperparameters = replace(START, walk=float(model["prior_walk"]), drift=float(model["prior_drift"]))
    plausible = all(0 <= sigma <= _ROUGHEST for sigma in (hyperparameters.walk, hyperparameters.drift))
    if not (plausible and coefficients.min() > 0 and coefficients.max() < _STEEPEST):
        raise ValueError("not coefficients of a response")
    information = _positive(np.linalg.inv(covariance).astype(np.float64) - prior.precision(hyperparameters))
    # The roughness of the prior is selected anew, so its share of the estimate cannot be subtracted from b.
    return coefficients, information, information @ coefficients


def _of_vignette(calibration: Calibration) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the estimated vignette parameters, and A and b of their likelihood."""
    vignette = calibration.vignette
    if not isinstance(vignette, LogSplineVignette):
        raise TypeError("another model of the vignette")
    covariance = np.array(calibration.covariance["vignette"]["matrix"], dtype=np.float64)
    given = [*vignette.coefficients]
    names = calibration.covariance["vignette"]["parameters"]
    place = [*range(len(given))]
    if "centre_x" in names:
        given, place = [*given, *vignette.centre], [*place, VIGNETTE.radial, VIGNETTE.radial + 1]
    if vignette.non_radial:
        given, place = [*given, *vignette.non_radial], [*place, *range(VIGNETTE.radial + 2, len(VIGNETTE))]
    if len(vignette.coefficients) != VIGNETTE.radial or covariance.shape != (len(place), len(place)):
        raise ValueError("another number of terms")
    estimate, matrix = np.zeros(len(VIGNETTE)), np.eye(len(VIGNETTE)) / _GIVEN_UP_SIGMA**2
    estimate[place] = given
    walk = float(calibration.covariance["vignette"]["prior_walk"])
    if not 0 <= walk <= _ROUGHEST:
        raise ValueError("not a vignette of the default method")
    precision = np.linalg.inv(covariance).astype(np.float64)
    basis = replace(VIGNETTE, usable_radius=_usable_radius(vignette))
    of_prior, _ = vignette_precision(basis, walk)
    of_prior = of_prior[np.ix_(place, place)]
    # In units of the prior, so that all parameters have the same scale.
    root = np.linalg.cholesky(of_prior)
    posterior, directions = np.linalg.eigh(np.linalg.solve(root, np.linalg.solve(root, precision).T))
    across = root @ directions
    own = np.maximum(posterior - 1, _LEAST_INFORMATION * posterior.max())
    matrix[np.ix_(place, place)] = (across * own) @ across.T
    # The prior is centred on zero: it contributes to the precision, but not to b = A θ of the likelihood.
    vector = np.zeros(len(VIGNETTE))
    vector[place] = across @ (
        np.where(posterior > 1 + _LEAST_OBSERVED, posterior, 0.0) * (across.T @ estimate[place])
    )
    return estimate, matrix, vector


def _positive(matrix: FloatArray) -> FloatArray:
    """Return the nearest positive definite matrix, because rounding may leave negative information in a direction."""
    value, vector = np.linalg.eigh((matrix + matrix.T) / 2)
    if value.max() <= 0:
        raise ValueError("no information")
    return np.asarray((vector * np.maximum(value, _LEAST_INFORMATION * value.max())) @ vector.T)
