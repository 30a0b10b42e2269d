"""The settings of the methods that a user may change, and the presets."""

from __future__ import annotations

import sys
from dataclasses import asdict, dataclass, fields, replace
from typing import TYPE_CHECKING, Any, TypeAlias

from ospc.arrays import ImageSize
from ospc.correspondence.features import EXTRACTORS
from ospc.errors import SettingError

if TYPE_CHECKING:
    from ospc.correspondence.frame_sampling import FrameSampler
    from ospc.correspondence.preprocessing import Preprocessor
    from ospc.methods.method import Method


def _check_numbers(settings: Settings) -> None:
    """Check that numbers are positive: all of them are sizes, counts, thresholds or ratios."""
    for entry in fields(settings):
        value = getattr(settings, entry.name)
        if isinstance(value, int | float) and not 0 < value <= sys.maxsize:
            raise SettingError(f"setting {entry.name} takes a positive number, not {str(value)[:40]}")


def _check_choice(name: str, value: str, choices: tuple[str, ...]) -> None:
    if value not in choices:
        raise SettingError(f"setting {name} is one of {', '.join(choices)}, not '{value}'")


@dataclass(frozen=True)
class PaperSettings:
    """The method of the paper, complete.

    Attributes
    ----------
    features
        "sift" (the paper), "orb" or "surf" (its ablation study).
    max_features
        Most features kept of a frame, the strongest; the paper gives no limit, this one bounds the time of matching.
    match_ratio
        Lowe's ratio test (Lowe 2004).
    filter_blocks, filter_bins, filter_min_matches, filter_length_sigmas
        The direction filter: 15×15 blocks, 10 bins, blocks of more than 5 matches, mean + 2σ (released program).
    response_window
        Frames behind one estimate of the response (paper, section 4.1).
    exposure_ratio_low, exposure_ratio_high
        Exposure ratios that make a pair worth matching (paper, section 4.1).
    response_max_radial_displacement
        Largest |R₀−R₁| of a sample for the response (released program: 0.01; pseudocode: 0.1).
    response_degree
        Degree of the polynomial g (paper, section 3.2).
    response_positivity
        When to ask for c ≥ 0: "never" is the paper's equation, "always" the released program; "when needed" asks
        only where the paper's solution does not increase and so is no response.
    vignette_window
        Frames behind one estimate of the vignette (paper, section 4.1).
    vignette_offset
        Frames between the two of a pair (paper, section 4.1).
    vignette_min_radial_displacement
        Smallest |R₀−R₁| of a sample for the vignette (paper, section 5).
    vignette_solver
        "l2", "l1" or "m-estimator" (paper, section 5; the M-estimator was its best).
    huber_tuning
        Threshold of the M-estimator in standard deviations (Huber 1964).
    acceptance_tolerance
        Largest median of |ln k̂ − ln k| over the pairs of an estimate that is accepted; the paper gives no number.
    min_samples
        Fewest correspondences an estimate may rest on.
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
    keeps_state = False

    def __post_init__(self) -> None:
        """Check every setting."""
        _check_numbers(self)
        _check_choice("features", self.features, tuple(EXTRACTORS))
        _check_choice("response_positivity", self.response_positivity, ("never", "when needed", "always"))
        _check_choice("vignette_solver", self.vignette_solver, ("l2", "l1", "m-estimator"))
        if not self.exposure_ratio_low < 1 < self.exposure_ratio_high:
            raise SettingError("exposure_ratio_low must be below 1 and exposure_ratio_high above")

    def sampler(self) -> FrameSampler:
        """Return what chooses the frames that are processed: all."""
        from ospc.correspondence.frame_sampling import FrameSampler

        return FrameSampler.every_frame()

    def preprocessor(self) -> Preprocessor:
        """Return what reduces frames for the check of exposures."""
        from ospc.correspondence.preprocessing import Preprocessor

        return Preprocessor()

    def build(self, size: ImageSize, max_grey: int) -> Method:
        """Return the method for images of a size and bit depth."""
        from ospc.methods.paper import PaperMethod

        return PaperMethod(self, size, max_grey)


@dataclass(frozen=True)
class DefaultSettings:
    """The default method: dense registration, flat sampling, and one robust maximum-likelihood fit.

    Attributes
    ----------
    frames_per_slowdown
        After so many processed frames, one more is skipped between two of them: the work grows with the square root
        of a recording's length.
    dense_frames
        Beyond so many processed frames, pauses grow with the fourth power of their number: the errors that all pairs
        have in common, and no further one reduces, are then the larger ones.
    longest_pause_frames
        Most frames skipped between two processed ones: ten seconds of film at 20 frames/s then hold twelve of them,
        enough to notice a change of the camera.
    comparison_period_frames, comparison_run_frames
        Of each period, the first so many consecutive frames are compared in brightness with their neighbours: four
        runs in ten seconds at 20 frames/s show whether exposures still belong to their frames.
    keyframes
        Most keyframes kept to compare with.
    max_log_ratio
        Change of exposure, in ln, beyond which a pair has no more information on the response.
    longest_side_px
        Length of the longer side, in pixels, to which images are reduced before they are compared.
    smoothing_px
        Standard deviation, in pixels, of the smoothing of grey levels before they are sampled.
    grid_spacing_px
        Distance in pixels between the places considered for sampling.
    max_gradient
        Largest grey gradient of a flat place, in full scale per pixel.
    max_forward_backward_error_px
        Largest distance in pixels between a place and the end of registering it there and back.
    points_per_pair
        Most scene points taken from a pair of frames.
    max_points
        Most scene points kept in all.
    registration
        How frames are registered: a name in :data:`ospc.correspondence.registration.REGISTRARS`.
    response_functions
        Functions that the response is composed of: a name in :data:`ospc.estimation.response_basis.FUNCTIONS`.
    response_intervals, series_intervals
        Intervals between the knots of the response, for a moving camera and for one that stands still, whose many
        observations of each point resolve more.
    radial_terms
        Number of radial terms of ln V.
    rounds
        Most rounds of the final fit after the first, convex one.
    still_px
        Median displacement in pixels up to which a camera counts as standing still.
    series_points
        Most scene points, each a pixel, taken from a camera that stands still.
    min_points
        Fewest scene points from which an estimate is made.
    min_log_exposure_change
        Smallest ln ratio of the extreme exposures from which a response is estimated.
    min_radial_reach
        Smallest radial displacement, in half diagonals, of the scene points that tell the vignette.
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
    response_intervals: int = 32
    series_intervals: int = 64
    radial_terms: int = 10
    rounds: int = 8
    still_px: float = 0.7
    series_points: int = 1_500
    min_points: int = 200
    min_log_exposure_change: float = 0.05
    min_radial_reach: float = 0.06

    name = "default"
    keeps_state = True

    def __post_init__(self) -> None:
        """Check every setting."""
        _check_numbers(self)

    def sampler(self) -> FrameSampler:
        """Return what chooses the frames that are processed."""
        from ospc.correspondence.frame_sampling import FrameSampler

        return FrameSampler(
            self.frames_per_slowdown,
            self.dense_frames,
            self.longest_pause_frames,
            self.comparison_period_frames,
            self.comparison_run_frames,
        )

    def preprocessor(self) -> Preprocessor:
        """Return what reduces frames to the size at which they are compared."""
        from ospc.correspondence.preprocessing import Preprocessor

        return Preprocessor(self.longest_side_px, self.smoothing_px)

    def build(self, size: ImageSize, max_grey: int) -> Method:
        """Return the method for images of a size and bit depth."""
        from ospc.methods.maximum_likelihood import MaximumLikelihoodMethod

        return MaximumLikelihoodMethod(self, size, max_grey)


@dataclass(frozen=True)
class FastSettings(DefaultSettings):
    """The default method with half the processed frames and a third of the points: errors are half as large again."""

    frames_per_slowdown: int = 20
    dense_frames: int = 80
    max_points: int = 20_000

    name = "fast"


Settings: TypeAlias = PaperSettings | DefaultSettings

_PRESETS: dict[str, Settings] = {"default": DefaultSettings(), "fast": FastSettings(), "paper": PaperSettings()}


def preset(name: str) -> Settings:
    """Return the settings of the preset "default", "fast" or "paper".

    Raises
    ------
    SettingError
        If there is no preset of that name.
    """
    if name not in _PRESETS:
        raise SettingError(f"no preset is called '{name}'; known: {', '.join(_PRESETS)}")
    return _PRESETS[name]


def with_overrides(settings: Settings, overrides: dict[str, str]) -> Settings:
    """Return the settings with some replaced by values given as text.

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
                f"no setting is called '{name}' in preset '{settings.name}'; known: {', '.join(known)}"
            )
        try:
            changes[name] = known[name](text)
        except ValueError:
            raise SettingError(f"setting {name} takes a value of type {known[name].__name__}, not '{text}'") from None
    return replace(settings, **changes)


def as_dict(settings: Settings) -> dict[str, Any]:
    """Return the name of the preset and every setting as JSON-compatible values."""
    return {"preset": settings.name, **asdict(settings)}
