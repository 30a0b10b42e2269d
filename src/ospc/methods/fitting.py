"""Response and vignette from your own observations, for example from another tracker or a SLAM program."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from ospc.arrays import ImageSize, numbers_of
from ospc.errors import ExposureError, FormatError, NotObservableError, SettingError, counted
from ospc.estimation.effect_choice import fit_with_chosen_effects
from ospc.estimation.fit import Fit
from ospc.estimation.fit_plan import FitPlan
from ospc.estimation.fitted import Fitted
from ospc.exposures.table import ExposureTable
from ospc.methods.exposure_ratios import exposure_ratios, unexplained_share
from ospc.methods.fit_inputs import FitInputs
from ospc.methods.identifiability import vignette_verdict
from ospc.methods.result import calibration_of
from ospc.observations import ExposedObservations, Observations
from ospc.photometry.calibration import Calibration
from ospc.photometry.coverage import ExposureRatios
from ospc.photometry.geometry import image_size
from ospc.photometry.grey_range import checked_max_grey
from ospc.photometry.noise import NoiseModel
from ospc.settings import DefaultSettings, Settings, as_dict, preset
from ospc.settings.methods import (
    CLEARLY_BETTER_CORRELATION,
    CLIPPED_OBSERVATIONS_SHARE,
    CONTRADICTING_UNEXPLAINED_SHARE,
)
from ospc.settings.vignette import MIN_USABLE_RADIUS
from ospc.system.versions import versions


def fit(
    observations: Observations,
    exposures_ms: npt.ArrayLike,
    *,
    noise: NoiseModel | None = None,
    vignette: bool = True,
    settings: Settings | str = "default",
) -> Fit:
    """Fit response and vignette to your own correspondences, as the default method does to its own.

    Parameters
    ----------
    observations
        Scene points, each with its grey level in two or more frames; :meth:`Observations.of_pairs
        <ospc.observations.Observations.of_pairs>` creates them from pairs.
    exposures_ms
        Exposure time in milliseconds times linear gain, indexed by frame number, NaN if unknown, shape (frames,).
        Scene points with an unknown exposure are ignored.
    noise
        Noise of single pixels, if the grey levels are means of several; None if they are single pixels.
    vignette
        Whether to estimate the vignette; False for a stationary camera.
    settings
        Settings of the default method, or the name of a preset of it.

    Returns
    -------
    Fit
        Its methods ``response`` and ``vignette`` return the results; for a calibration with verdicts, which can be
        saved and exported, use :func:`calibrate_observations`.

    Raises
    ------
    SettingError
        If shapes do not match, values are out of range, a frame has no exposure, or the settings are not of the
        default method.
    NotObservableError
        If there are too few scene points, their exposures hardly change, or (by :func:`fit` only) they move too
        little to determine the vignette.
    ExposureError
        If the grey levels do not follow the exposures, with the probable reason: clipped points, inverse exposures,
        frame numbers off by one, or inexact exposures.

    Examples
    --------
    >>> import ospc
    >>> pairs = ospc.Observations.of_pairs(grey0, grey1, position0, position1, frame0, frame1)  # doctest: +SKIP
    >>> found = ospc.fit(pairs, exposures_ms)  # doctest: +SKIP
    >>> response, vignette = found.response(), found.vignette((640, 480))  # doctest: +SKIP
    """
    known, exposures = _known(settings), _exposures(observations, exposures_ms, noise)
    found = _fitted(observations.with_exposures(exposures), noise, vignette, known)
    _check_explained(exposure_ratios(found.fit, found.observations), observations, exposures)
    if vignette:
        # The shape of the images is unknown, so the uncertainty is that along the diagonals of a square.
        motion = found.observations.radial_motion
        verdict = vignette_verdict(found.fit, motion, stationary=False, unexplained=0.0, size=(2, 2))
        if not verdict.known:
            raise NotObservableError(
                f"{verdict.reason}; add pairs of frames between which the camera rotates, or pass vignette=False"
            )
    return found.fit


def calibrate_observations(
    observations: Observations,
    exposures_ms: npt.ArrayLike,
    size: ImageSize,
    *,
    max_grey: int = 255,
    noise: NoiseModel | None = None,
    vignette: bool = True,
    settings: Settings | str = "default",
) -> Calibration:
    """Calibrate a camera from your own correspondences, with the verdicts of the default method.

    Parameters
    ----------
    observations, exposures_ms, noise, vignette, settings
        As for :func:`fit`.
    size
        Width and height of the images in pixels.
    max_grey
        Largest grey value of the images: 255 for 8 bit.

    Returns
    -------
    Calibration
        Curves that the observations do not determine are None; their verdicts say why. There is no verdict on the
        exposures, which the fit has only been checked against.

    Raises
    ------
    SettingError, NotObservableError, ExposureError
        As for :func:`fit`.
    """
    known, shape = _known(settings), _checked_size(size)
    largest = checked_max_grey(max_grey, "the images", SettingError)
    exposures = _exposures(observations, exposures_ms, noise)
    exposed = observations.with_exposures(exposures)
    found = _fitted(exposed, noise, vignette, known)
    inputs = FitInputs(
        size=shape,
        max_grey=largest,
        noise=NoiseModel(0.0, 0.0) if noise is None else noise,
        observations=exposed,
        fitted=found,
        stationary=not vignette,
        pairs=len(np.unique(found.observations.group)),
    )
    _check_explained(inputs.ratios, observations, exposures)
    calibration = calibration_of(inputs, known)
    return replace(calibration, noise=noise, settings=as_dict(known), versions=versions())


def _checked_size(size: ImageSize) -> ImageSize:
    """Return the size of images as two whole numbers; SettingError if it is no possible size."""
    values = numbers_of(size)
    if values is not None and values.shape == (2,) and np.isfinite(values).all() and np.all(values % 1 == 0):
        with suppress(FormatError):
            return image_size(*values.tolist())
    raise SettingError(f"size is {size!r}; give width and height of the images in pixels, such as (640, 480)")


def _known(settings: Settings | str) -> DefaultSettings:
    """Return the settings of the default method; SettingError for others."""
    known = preset(settings) if isinstance(settings, str) else settings
    if not isinstance(known, DefaultSettings):
        raise SettingError(
            f"settings are {settings!r}; give 'default', 'fast' or settings such as DefaultSettings(min_points=100)"
        )
    return known


def _exposures(observations: Observations, exposures_ms: npt.ArrayLike, noise: NoiseModel | None) -> ExposureTable:
    """Return the exposures as a table, after checking everything given; errors as for :func:`fit`."""
    if not isinstance(observations, Observations) or not isinstance(noise, NoiseModel | None):
        given = f"{type(observations).__name__} and {type(noise).__name__}"
        raise SettingError(
            f"observations and noise must be of types Observations and NoiseModel or None, not {given}"
        )
    observations.check()
    values = numbers_of(exposures_ms)
    if values is None:
        raise SettingError("exposures_ms must be numbers, one per frame")
    if values.ndim != 1:
        raise SettingError(f"exposures_ms must have one value per frame, not shape {values.shape}")
    last = int(observations.frame.astype(np.int64).max(initial=-1))
    if last >= len(values):
        raise SettingError(f"frame {last} has no exposure: exposures_ms ends at frame {len(values) - 1}")
    if np.any(values <= 0) or np.any(np.isinf(values)):
        raise SettingError("exposures must be positive numbers of milliseconds, or NaN if unknown")
    return ExposureTable.of(np.log(values))


def _fitted(
    observations: ExposedObservations, noise: NoiseModel | None, vignette: bool, settings: DefaultSettings
) -> Fitted:
    """Fit the observations; NotObservableError as for :func:`fit`."""
    points = len(observations.starts)
    if points < settings.min_points:
        raise NotObservableError(
            f"only {counted(points, 'scene point')} with known exposures; at least {settings.min_points} are needed"
        )
    if observations.log_exposure_change(settings.min_points) < settings.min_log_exposure_change:
        raise NotObservableError(
            f"fewer than {settings.min_points} of {counted(points, 'scene point')} were seen at different exposures, "
            "so the response cannot be determined; add pairs of frames with different exposures"
        )
    if vignette:
        radius = float(np.clip(np.linalg.norm(observations.position, axis=1).max(), MIN_USABLE_RADIUS, 1.0))
        plan = FitPlan.of_moving_camera(settings, noise, radius)
    else:
        plan = FitPlan.of_stationary_camera(settings, noise)
    return fit_with_chosen_effects(observations, plan)


def _check_explained(ratios: ExposureRatios, observations: Observations, exposures: ExposureTable) -> None:
    """Raise an ExposureError if the grey levels do not follow the exposures, given the ratios of a fit."""
    unexplained = unexplained_share(ratios)
    if unexplained > CONTRADICTING_UNEXPLAINED_SHARE:
        raise ExposureError(
            f"{min(unexplained, 1):.0%} of a typical change of exposure does not show in the grey levels",
            _remedy(observations, exposures),
        )


def _remedy(observations: Observations, exposures: ExposureTable) -> str:
    """Return the probable reason why grey levels do not follow the exposures, and what to do about it."""
    clipped = float(np.mean(observations.grey >= 1))
    if clipped > CLIPPED_OBSERVATIONS_SHARE:
        return f"{clipped:.0%} of the grey levels are clipped at 1: leave out points that are clipped in a frame"
    as_given = _correlation(observations, exposures)
    others = {
        "they fall where exposures rise: give exposure times in ms, not their inverse": -as_given,
        "frame numbers seem to be one too low": _correlation(observations, replace(exposures, lag_frames=1)),
        "frame numbers seem to be one too high": _correlation(observations, replace(exposures, lag_frames=-1)),
    }
    best = max(others, key=others.__getitem__)
    if others[best] > as_given + CLEARLY_BETTER_CORRELATION:
        return best
    return "the exposures are inexact or of other frames: give one exposure time in ms per frame, by frame number"


def _correlation(observations: Observations, exposures: ExposureTable) -> float:
    """Return the correlation of the changes of grey level and of ln exposure between two views of a point."""
    first, last = observations.starts, observations.starts + observations.counts - 1
    log_exposure = exposures.log_exposure_of(observations.frame)
    changes = np.stack([values[last] - values[first] for values in (observations.grey, log_exposure)])
    changes = changes[:, np.isfinite(changes).all(axis=0)]
    if changes.shape[1] < 2 or not np.all(np.ptp(changes, axis=1) > 0):
        return 0.0
    return float(np.corrcoef(changes)[0, 1])
