"""User settings of the methods, and the presets."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import Field, asdict, dataclass, fields, replace
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, TypeVar

import numpy as np

from ospc.arrays import ImageSize
from ospc.correspondence.features import EXTRACTORS
from ospc.correspondence.frame_sampling import FrameSampler
from ospc.errors import SettingError, known_names, named
from ospc.settings.response import MOST_RESPONSE_INTERVALS
from ospc.settings.vignette import MOST_RADIAL_TERMS

if TYPE_CHECKING:
    from ospc.correspondence.preprocessing import Preprocessor
    from ospc.methods.maximum_likelihood_state import MaximumLikelihoodState
    from ospc.methods.method import Method


class Settings(Protocol):
    """Settings of a method: a frozen dataclass that makes what the engine needs to run the method.

    Attributes
    ----------
    name
        Name of the preset.
    real_time
        Whether the method keeps up with a camera; a live calibrator refuses one that does not.
    """

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    @property
    def name(self) -> str: ...  # noqa: D102 (described above)

    @property
    def real_time(self) -> bool: ...  # noqa: D102

    def sampler(self) -> FrameSampler:
        """Return the frame sampler, which selects the frames to process."""

    def preprocessor(self) -> Preprocessor:
        """Return the preprocessor, which prepares frames for the method and for the check of exposures."""

    def build(self, size: ImageSize, max_grey: int) -> Method:
        """Return the method for an image size and bit depth."""

    def state_type(self) -> type | None:
        """Return the dataclass of the method's state; None if its runs cannot be saved and continued."""


_LIMITS = {
    "response_intervals": (2, MOST_RESPONSE_INTERVALS),
    "series_intervals": (2, MOST_RESPONSE_INTERVALS),
    "radial_terms": (1, MOST_RADIAL_TERMS),
}
"""Smallest and largest value of settings for which these are not 0 and infinity."""


def _check_values(settings: Settings) -> None:
    """Check types and limits; every number is a size, count, threshold or ratio, and positive."""
    for entry in fields(settings):
        value, kind = getattr(settings, entry.name), type(entry.default)
        if isinstance(value, np.generic):
            value = value.item()
            object.__setattr__(settings, entry.name, value)
        accepted = int | float if kind is float else kind
        if kind in (int, float, str) and (isinstance(value, bool) or not isinstance(value, accepted)):
            raise SettingError(f"setting {entry.name} takes a value of type {kind.__name__}, not {str(value)[:40]!r}")
        if isinstance(value, int | float) and not 0 < value <= sys.maxsize:
            raise SettingError(f"setting {entry.name} takes a positive number, not {str(value)[:40]}")
        least, most = _LIMITS.get(entry.name, (0, sys.maxsize))
        if isinstance(value, int | float) and not least <= value <= most:
            raise SettingError(f"setting {entry.name} is {value}; give a number from {least} to {most}")


def _check_choice(name: str, value: str, choices: tuple[str, ...]) -> None:
    if value not in choices:
        raise SettingError(f"setting {name} is one of {', '.join(choices)}, not '{value}'")


@dataclass(frozen=True)
class PaperSettings:
    """The complete method of the paper.

    Attributes
    ----------
    features
        "sift" (the paper), "orb" or "surf" (its ablation study).
    max_features
        Number of features kept per frame, strongest first. The paper gives no limit; this one bounds the matching
        time.
    match_ratio
        Threshold of Lowe's ratio test (Lowe 2004).
    filter_blocks, filter_bins, filter_min_matches, filter_length_sigmas
        Direction filter: 15×15 blocks, 10 bins, blocks with more than 5 matches, mean + 2σ (released program).
    response_window
        Number of frames per response estimate (paper, section 4.1).
    exposure_ratio_low, exposure_ratio_high
        A pair is matched if its exposure ratio lies outside this range (paper, section 4.1).
    response_max_radial_displacement
        Largest |R₀−R₁| of a response sample (released program: 0.01; pseudocode: 0.1).
    response_degree
        Degree of the polynomial g (paper, section 3.2).
    response_positivity
        When to enforce c ≥ 0: "never" solves the paper's equation, "always" matches the released program, and
        "when needed" enforces it only if the paper's solution is not increasing and therefore not a response.
    vignette_window
        Number of frames per vignette estimate (paper, section 4.1).
    vignette_offset
        Number of frames between the two frames of a pair (paper, section 4.1).
    vignette_min_radial_displacement
        Smallest |R₀−R₁| of a vignette sample (paper, section 5).
    vignette_solver
        "l2", "l1" or "m-estimator" (paper, section 5, where the M-estimator performed best).
    huber_tuning
        Threshold of the M-estimator, in standard deviations (Huber 1964).
    acceptance_tolerance
        An estimate is accepted if the median of |ln k̂ − ln k| over its pairs is at most this. The paper gives no
        number.
    min_samples
        Minimum number of correspondences for an estimate.
    """

    features: str = "sift"
    max_features: int = 2000
    match_ratio: float = 0.75
    filter_blocks: int = 15
    filter_bins: int = 10
    filter_min_matches: int = 5
    filter_length_sigmas: float = 2.0
    response_window: int = 200
    exposure_ratio_low: float = 0.92
    exposure_ratio_high: float = 1.08
    response_max_radial_displacement: float = 0.01
    response_degree: int = 2
    response_positivity: str = "when needed"
    vignette_window: int = 400
    vignette_offset: int = 30
    vignette_min_radial_displacement: float = 0.2
    vignette_solver: str = "m-estimator"
    huber_tuning: float = 1.345
    acceptance_tolerance: float = 0.2
    min_samples: int = 100

    name = "paper"
    real_time = False

    def __post_init__(self) -> None:
        """Validate the settings."""
        _check_values(self)
        _check_choice("features", self.features, tuple(EXTRACTORS))
        _check_choice("response_positivity", self.response_positivity, ("never", "when needed", "always"))
        _check_choice("vignette_solver", self.vignette_solver, ("l2", "l1", "m-estimator"))
        if not self.exposure_ratio_low < 1 < self.exposure_ratio_high:
            raise SettingError("exposure_ratio_low must be below 1 and exposure_ratio_high above")

    def sampler(self) -> FrameSampler:
        """Return the frame sampler, which selects every frame."""
        return FrameSampler.every_frame()

    def preprocessor(self) -> Preprocessor:
        """Return the preprocessor for the exposure check."""
        from ospc.correspondence.preprocessing import Preprocessor

        return Preprocessor(DefaultSettings.longest_side_px, DefaultSettings.smoothing_px)

    def state_type(self) -> None:
        """Return None: the features of hundreds of frames are too large for a state."""

    def build(self, size: ImageSize, max_grey: int) -> Method:
        """Return the method for an image size and bit depth."""
        from ospc.methods.paper import PaperMethod

        return PaperMethod(self, size, max_grey)


@dataclass(frozen=True)
class DefaultSettings:
    """The default method: dense registration, flat sampling and a robust maximum-likelihood fit.

    Attributes
    ----------
    frames_per_slowdown
        After every n processed frames, one more frame is skipped between two processed frames, so the work grows with
        the square root of the recording's length.
    dense_frames
        Beyond this many processed frames, the skips grow with the fourth power of the number of frames. By then,
        errors common to all pairs, which further pairs do not reduce, dominate.
    longest_pause_frames
        Maximum number of frames skipped between two processed frames. At 20 frames/s, ten seconds then contain twelve
        processed frames, enough to detect a change of the camera.
    comparison_period_frames, comparison_run_frames
        Each period starts with a run of consecutive frames whose brightness is compared with their neighbours'. At 20
        frames/s, ten seconds contain four runs, enough to check that the exposures still belong to their frames.
    keyframes
        Maximum number of keyframes kept for comparison.
    max_log_ratio
        Change of ln exposure beyond which a pair no longer provides information about the response.
    longest_side_px
        Images are reduced until their longer side has at most this length, in pixels, before they are compared; 800
        keeps 640×480 unchanged and halves 1280×1024. The shorter side keeps at least 32 pixels.
    smoothing_px
        Standard deviation, in pixels, of the smoothing applied to grey levels before sampling.
    grid_spacing_px
        Distance, in pixels, between candidate sampling points.
    max_gradient
        Largest grey gradient of a flat point, in full scale per pixel.
    max_forward_backward_error_px
        Largest forward-backward registration error of a sampled point, in pixels.
    points_per_pair
        Maximum number of scene points sampled from a pair of frames.
    max_points
        Maximum number of scene points kept in total.
    registration
        Registration method: a name in :data:`ospc.correspondence.registration.REGISTRARS`.
    response_functions
        Basis functions of the response: a name in :data:`ospc.estimation.response_basis.FUNCTIONS`.
    response_intervals, series_intervals
        Number of intervals between the knots of the response, for a moving and for a stationary camera. A stationary
        camera observes each point many times and so resolves more. For a moving camera with a knee, 32 instead of 48
        raise κ by a fifth, and errors across the knee reached eight standard deviations; 64 give the same as 48.
    radial_terms
        Number of knots of ln V in R².
    rounds
        Maximum number of rounds of a fit after the first in which outliers lose weight.
    stationary_px
        Median displacement, in pixels, up to which a camera counts as stationary.
    series_points
        Maximum number of scene points (single pixels) used from a stationary camera.
    min_points
        Minimum number of scene points for an estimate.
    min_log_exposure_change
        Minimum ln ratio between the longest and the shortest exposure for estimating a response.
    """

    frames_per_slowdown: int = 60
    dense_frames: int = 100
    longest_pause_frames: int = 16
    comparison_period_frames: int = 48
    comparison_run_frames: int = 8
    keyframes: int = 20
    max_log_ratio: float = 1.2
    longest_side_px: int = 800
    smoothing_px: float = 1.5
    grid_spacing_px: int = 8
    max_gradient: float = 0.006
    max_forward_backward_error_px: float = 2.0
    points_per_pair: int = 400
    max_points: int = 60_000
    registration: str = "dense"
    response_functions: str = "hats"
    response_intervals: int = 48
    series_intervals: int = 64
    radial_terms: int = 16
    rounds: int = 8
    stationary_px: float = 0.7
    series_points: int = 1_500
    min_points: int = 200
    min_log_exposure_change: float = 0.05

    name = "default"
    real_time = True

    def __post_init__(self) -> None:
        """Validate the settings."""
        _check_values(self)
        if self.smoothing_px > self.longest_side_px:
            raise SettingError("smoothing_px must not be above longest_side_px")

    def sampler(self) -> FrameSampler:
        """Return the frame sampler."""
        return FrameSampler(
            self.frames_per_slowdown,
            self.dense_frames,
            self.longest_pause_frames,
            self.comparison_period_frames,
            self.comparison_run_frames,
        )

    def preprocessor(self) -> Preprocessor:
        """Return the preprocessor, which reduces frames to the size at which they are compared."""
        from ospc.correspondence.preprocessing import Preprocessor

        return Preprocessor(self.longest_side_px, self.smoothing_px)

    def state_type(self) -> type[MaximumLikelihoodState]:
        """Return the class of the method's state."""
        from ospc.methods.maximum_likelihood_state import MaximumLikelihoodState

        return MaximumLikelihoodState

    def build(self, size: ImageSize, max_grey: int) -> Method:
        """Return the method for an image size and bit depth."""
        from ospc.methods.maximum_likelihood import MaximumLikelihoodMethod

        return MaximumLikelihoodMethod(self, size, max_grey)


@dataclass(frozen=True)
class FastSettings(DefaultSettings):
    """The default method with half as many processed frames and a third of the points: 1.5 times the error."""

    frames_per_slowdown: int = 20
    dense_frames: int = 80
    max_points: int = 20_000

    name = "fast"


S = TypeVar("S", bound=Settings)

_ANY_SIZE, _ANY_GREY = (640, 480), 255
"""Images for which a method is built only to check its settings."""
PRESETS: dict[str, Settings] = {"default": DefaultSettings(), "fast": FastSettings(), "paper": PaperSettings()}
"""The settings of every preset, by its name."""


def preset(name: str) -> Settings:
    """Return the settings of the preset "default", "fast" or "paper".

    Raises
    ------
    SettingError
        If there is no preset of that name.
    """
    return named("preset", name, PRESETS)


def with_overrides(settings: S, overrides: dict[str, str], others: Sequence[str] = ()) -> S:
    """Return the settings with some values replaced.

    Parameters
    ----------
    overrides
        New values as text, by the names of the settings.
    others
        Names of options that could have been meant by an unknown name; the message proposes them too.

    Raises
    ------
    SettingError
        If a name is unknown or a value has the wrong type.
    """
    changes: dict[str, Any] = {}
    known = {f.name: type(getattr(settings, f.name)) for f in fields(settings)}
    for name, text in overrides.items():
        if name not in known:
            raise SettingError(
                f"no setting is called '{name}' in preset '{settings.name}'; {known_names(name, [*others, *known])}"
            )
        try:
            changes[name] = known[name](text)
        except ValueError:
            raise SettingError(f"setting {name} takes a value of type {known[name].__name__}, not '{text}'") from None
    return replace(settings, **changes)


def check_names(settings: Settings) -> None:
    """Raise a SettingError if a setting names a part of the method that does not exist; only building it tells."""
    settings.build(_ANY_SIZE, _ANY_GREY)


def as_dict(settings: Settings) -> dict[str, Any]:
    """Return the preset's name and all settings as JSON-compatible values."""
    return {"preset": settings.name, **asdict(settings)}
