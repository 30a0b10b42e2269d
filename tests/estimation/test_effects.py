"""Effects other than response and vignette are detected and corrected when present, and only then."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ospc.arrays import FloatArray
from ospc.estimation.effect_choice import fit_with_chosen_effects
from ospc.estimation.effect_models import (
    CONTRADICTIONS,
    CORRECTED,
    EFFECTS,
    GAIN_STEPS,
    GLARE_OF_WHITE,
    ONLY_IF_FOUND,
)
from ospc.estimation.effect_trials import trial_of
from ospc.estimation.effects import Effects, ResponseTables
from ospc.estimation.fit import Fit
from ospc.estimation.fit_plan import FitPlan
from ospc.estimation.response_basis import ResponseBasis, typical_gamma
from ospc.estimation.vignette_basis import VignetteBasis
from ospc.evaluation.metrics import log_ratio_error, vignette_rmse
from ospc.methods.contradictions import contradictions_of
from ospc.observations import ExposedObservations
from ospc.photometry.noise import NoiseModel
from ospc.photometry.verdict import EffectEstimate
from ospc.settings.effects import ADDED_LIGHT_MODEL_ERROR, BEYOND_WHITE
from ospc.simulation.responses import RESPONSES
from synthetic_observations import POLYNOMIAL, ROUNDS, SIZE

GAMMA = RESPONSES["srgb"]()
NOISE = NoiseModel(0.0, 0.0)
PLAN = FitPlan(ResponseBasis(32), VignetteBasis(8, free_centre=True, non_radial=True), NOISE, ROUNDS)
FRAMES, POINTS = 120, 40
FEW = 50
TYPICAL_MS = 10.0


@dataclass(frozen=True)
class Disturbed:
    """A camera with disturbing effects, simulated from their definitions in the documentation."""

    glare: float = 0.0
    most_white: float = 0.0
    beyond_white: float = BEYOND_WHITE
    """How much brighter than white the white pixels are."""
    varying_white: float = 0.0
    """Standard deviation of its logarithm between frames."""
    sky: float = 0.0
    """How bright the white pixels are at the typical exposure, if their light grows with it."""
    scatter: float = 0.0
    wide_scatter: float = 0.0
    dark: float = 0.0
    stray: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Stray light at the corners, and its gradients along x and y."""
    spot: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Stray light, dark signal and share of the frame's mean light in a spot in the centre."""
    leak: float = 0.0
    """Stray light in the lower right corner."""
    tilted_black: float = 0.0
    """Gradient of a dark signal along y."""
    step: float = 0.0
    """Step of ln of the gain, at 1.2 times the typical exposure."""
    speeds: tuple[int, ...] = ()
    """Nominal shutter speeds, such as 60 for 1/60 s, used at random; any exposures if empty."""
    per_stop: int = 3
    """Number of nominal shutter speeds per stop."""
    errors: tuple[float, ...] = ()
    """Errors of ln of the exposures with these speeds, if they are not those of nominal speeds."""
    offset: float = 0.0
    late: float = 0.0
    power_of_logarithm: float = 0.0
    tone: float = 0.0
    gamma_drift: float = 0.0
    black_drift: float = 0.0
    black_by_exposure: float = 0.0
    vignette_drift: float = 0.0
    vignette_by_exposure: float = 0.0
    vignette_motion: tuple[float, float] = (0.0, 0.0)
    square: float = 0.0
    smudge: float = 0.0
    unsteady: float = 0.0
    stabilised: float = 0.0
    local: float = 0.0
    light: float = 0.0
    slow_light: float = 0.0
    rise: float = 0.0
    """Rise of ln of the light from the first frame to the last."""
    ramp: bool = False
    """Whether the exposure only rises."""
    jitter: float = 0.0
    """Standard deviation of ln of the exposure about the ramp."""
    apart: int = 1
    """Distance in frames of the two frames of a pair."""
    shortest: float = -1.0
    """ln of the shortest exposure relative to the typical one."""

    def pairs(self, seed: int = 0) -> ExposedObservations:
        """Return points, each seen in two frames that differ in exposure, mean light and surroundings."""
        random = np.random.default_rng(seed)
        n = FRAMES * POINTS
        group = np.repeat(np.arange(FRAMES), POINTS)
        time_of = np.linspace(-1, 1, FRAMES)[:, None]
        time = time_of[group]
        true_ms = TYPICAL_MS * np.exp(random.uniform(self.shortest, 1, (FRAMES, 2)))[group]
        number = 2 * np.arange(FRAMES)[:, None] + [0, self.apart]
        part = (number / number.max())[group]
        jitter = np.random.default_rng([seed, 2]).normal(0, self.jitter, (FRAMES, 2))[group]
        true_ms = TYPICAL_MS * np.exp(2 * part - 1 + jitter) if self.ramp else true_ms
        rate = random.normal(0, 0.1, (FRAMES, 2))[group]
        stated_ms = true_ms * np.exp(-self.late * rate) - self.offset * TYPICAL_MS
        if self.speeds:
            level = random.integers(len(self.speeds), size=(FRAMES, 2))[group]
            stated_ms = 1000 / np.array(self.speeds)[level]
            exact_ms = 1000 * 2 ** (np.round(self.per_stop * np.log2(stated_ms / 1000)) / self.per_stop)
            true_ms = stated_ms * np.exp(np.array(self.errors)[level]) if self.errors else exact_ms
        stretched = np.log(stated_ms / TYPICAL_MS)
        stated_ms = TYPICAL_MS * np.exp(stretched - self.power_of_logarithm * stretched**2)
        log_light = self.light * random.standard_normal((FRAMES, 2)) + self.slow_light * np.sin(12 * time_of) * [0, 1]
        lit_ms = true_ms * np.exp(log_light)[group] * np.exp(self.step * (true_ms > 1.2 * TYPICAL_MS))
        radiance = np.exp(random.normal(-1.5, 0.9, n))[:, None] / TYPICAL_MS * np.exp(self.rise * part)
        place = random.uniform(-1, 1, (n, 2, 2)) * np.array(SIZE) / np.hypot(*SIZE)
        squared_radius = np.sum(place**2, axis=2)
        moved = self.stabilised * random.standard_normal((FRAMES, 2, 2))[group]
        attenuation = POLYNOMIAL.at_normalised(place + moved) * np.exp(self.vignette_drift * time * squared_radius)
        attenuation *= np.exp(self.vignette_by_exposure * np.log(true_ms / TYPICAL_MS) * squared_radius)
        attenuation *= np.exp(-self.square * np.max(np.abs(place), axis=2) ** 4)
        attenuation *= np.exp(time * (place @ np.array(self.vignette_motion)))
        attenuation *= 1 - self.smudge * np.exp(-np.sum((place - [0.3, 0.2]) ** 2, axis=2) / (2 * 0.1**2))
        # Mean light and surroundings are each simulated as a uniform patch, so the grey moments are plain powers.
        frame_light = np.exp(random.normal(-1.2, 0.4, (FRAMES, 2)))[group]
        # The brightest frames have the most white pixels; white pixels have their usual brightness.
        white = self.most_white * np.clip(frame_light, 0, 1) ** 2
        frame_moments = (1 - white)[..., None] * GAMMA(frame_light)[..., None] ** np.arange(1, 6) + white[..., None]
        frame_moments = np.concatenate([frame_moments, white[..., None]], axis=2)
        excess = self.varying_white * np.random.default_rng([seed, 1]).standard_normal((FRAMES, 2))[group]
        of_white = self.sky * true_ms / TYPICAL_MS if self.sky else 1 + self.beyond_white * np.exp(excess)
        frame_light = (1 - white) * frame_light + white * of_white
        nearby = np.exp(random.normal(-1.2, 0.6, (n, 2)))
        widely = np.exp(np.random.default_rng([seed, 3]).normal(-1.2, 0.6, (n, 2)))
        corners, sideways, vertically = self.stray
        fixed = self.dark + corners * squared_radius + sideways * place[..., 0] + vertically * place[..., 1]
        fixed = fixed + self.leak * np.exp(-np.linalg.norm(place - [0.8, 0.6], axis=2) / 0.2)
        centre = np.exp(-squared_radius / 0.25**2)
        growing, constant, of_scene = (size * centre for size in self.spot)
        constant = constant + self.tilted_black * place[..., 1]
        added = self.glare * frame_light + self.scatter * nearby + self.wide_scatter * widely
        added = added + (fixed + growing) * true_ms / TYPICAL_MS
        added = added + constant + of_scene * frame_light
        grey = GAMMA(lit_ms * radiance * attenuation + added)
        around = GAMMA(nearby)
        own = self.unsteady * random.standard_normal((FRAMES, 2))[group]
        grey = grey ** (1 + self.gamma_drift * time + own) * around**self.tone
        grey += self.black_drift * time + self.black_by_exposure * np.log(true_ms / TYPICAL_MS)
        grey *= np.exp(self.local * random.standard_normal((n, 2)))
        noisy = grey + 0.3 / 255 * random.standard_normal((n, 2))
        exposed = np.all((grey > 8 / 255) & (grey < 0.97), axis=1)

        def both(values: FloatArray) -> FloatArray:
            return np.broadcast_to(values, (n, 2, *values.shape[2:]))[exposed].reshape(-1, *values.shape[2:])

        both_around = np.stack([around, GAMMA(widely)], axis=2)[..., None]
        surround_moments = np.concatenate([both_around ** np.arange(6), np.zeros((n, 2, 2, 1))], axis=3)
        return ExposedObservations(
            grey=both(noisy),
            position=both(place),
            gradient=both(np.zeros((n, 2))),
            grey_variance=both(np.zeros((n, 2))),
            grey_third_moment=both(np.zeros((n, 2))),
            frame_moments=both(frame_moments),
            surround_moments=both(surround_moments),
            frame=both(number[group]),
            point=np.repeat(np.arange(exposed.sum()), 2),
            group=both(group[:, None]),
            log_exposure=both(np.log(stated_ms)),
            log_exposure_rate=both(rate),
        )

    def fit(self, seed: int = 0, frames: int = FRAMES) -> Fit:
        """Fit the first ``frames`` pairs of frames; several tests share the same fits."""
        return self._fit(seed, frames)

    @cache  # noqa: B019 - it tells calls with and without a default apart, so all arguments are given
    def _fit(self, seed: int, frames: int) -> Fit:
        everything = self.pairs(seed)
        observations = everything.of_points(everything.group[everything.starts] < frames)
        return fit_with_chosen_effects(observations, PLAN).fit


def stated(fit: Fit) -> dict[str, float]:
    """Return the effects that a fit corrected or reports as contradicting the model."""
    return {one.name: one.value for one in fit.effect_estimates if one.corrected or one.contradicts}


def is_right(fit: Fit) -> bool:
    """Return whether response and vignette are accurate enough for correcting images."""
    vignette = vignette_rmse(fit.vignette(SIZE), POLYNOMIAL, 1.0)
    return log_ratio_error(fit.response(), GAMMA) < 0.005 and vignette < 0.005


@pytest.mark.parametrize("seed", range(4))
def test_a_camera_without_effects_has_none(seed: int) -> None:
    found = Disturbed().fit(seed)
    assert not stated(found)
    assert is_right(found)
    assert [one.name for one in found.effect_estimates] == [name for name in CORRECTED if name not in ONLY_IF_FOUND]
    assert all(abs(one.value) < 4 * one.sigma for one in found.effect_estimates)


@pytest.mark.parametrize(
    ("camera", "name", "value"),
    [
        (Disturbed(glare=0.03), "veiling glare", 0.03),
        (Disturbed(glare=0.03, most_white=0.3), "veiling glare", 0.03),
        (Disturbed(scatter=0.04), "light scattered nearby", 0.04),
        (Disturbed(wide_scatter=0.04), "light scattered widely", 0.04),
        (Disturbed(stray=(0.01, 0, 0)), "stray light at the corners", 0.01),
        (Disturbed(stray=(0.0015, 0, 0)), "stray light at the corners", 0.0015),
        (Disturbed(offset=0.05), "exposure offset", 0.05),
        (Disturbed(offset=-0.05), "exposure offset", -0.05),
        (Disturbed(late=0.4), "late exposures", 0.4),
        (Disturbed(rise=-0.05, apart=20), "drifting light", -0.05),
    ],
)
def test_an_effect_of_a_camera_is_measured_and_corrected(camera: Disturbed, name: str, value: float) -> None:
    found = camera.fit()
    assert stated(found) == {name: pytest.approx(value, rel=0.15)}
    assert is_right(found)


def test_a_leak_at_one_side_does_not_bend_the_vignette() -> None:
    found = Disturbed(stray=(0, 0.003, -0.01)).fit()
    assert stated(found) == {
        "stray light sideways": pytest.approx(0.003, rel=0.15),
        "stray light vertically": pytest.approx(-0.01, rel=0.15),
    }
    assert is_right(found)


@pytest.mark.parametrize(
    ("camera", "names"),
    [
        (Disturbed(spot=(0.005, 0, 0)), {"stray light in the centre", "stray light around the centre"}),
        (Disturbed(spot=(-0.005, 0, 0)), {"stray light in the centre", "stray light around the centre"}),
        (Disturbed(spot=(0, 0.005, 0)), {"dark signal in the centre", "dark signal around the centre"}),
        (Disturbed(spot=(0, 0, 0.02)), {"glare in the centre", "glare around the centre"}),
        (Disturbed(leak=0.008), {"stray light at the bottom right"}),
        (Disturbed(tilted_black=0.004), {"dark signal vertically"}),
    ],
)
def test_light_in_a_part_of_the_image_does_not_bend_the_vignette(camera: Disturbed, names: set[str]) -> None:
    """The shapes of the model differ a little from the true ones: two spots imitate one between them."""
    found = camera.fit()
    assert stated(found).keys() <= names
    assert stated(found)
    assert is_right(found)


def test_a_uniform_dark_signal_counts_only_where_the_lens_is_darker() -> None:
    """A share of V would look like a brighter scene, so only d (1 - V) is observable."""
    found = Disturbed(dark=0.02).fit()
    assert stated(found).keys() == {"stray light at the corners"}
    assert 0 < stated(found)["stray light at the corners"] < 0.02
    assert is_right(found)


@pytest.mark.parametrize("step", [-0.01, 0.005, 0.05])
def test_a_step_of_the_gain_is_measured_and_corrected(step: float) -> None:
    found = Disturbed(step=step).fit()
    ((name, value),) = stated(found).items()
    place = found.effects.step_exposures[GAIN_STEPS.index(name)]
    assert place * np.exp(found.effects.log_typical_exposure) == pytest.approx(1.2 * TYPICAL_MS, rel=0.15)
    assert value == pytest.approx(step, rel=0.2)
    assert is_right(found)
    assert abs(step_in_sigmas(found)) < 3


@pytest.mark.parametrize(
    ("speeds", "per_stop"),
    [
        ((400, 320, 250, 200, 160, 125, 100, 80), 3),
        # The first is closer to a half of a stop than to a third, as with an error that all exposures share.
        ((380, 320, 250, 200, 160, 125, 100, 80), 3),
        ((350, 250, 180, 125, 90, 60, 45), 2),
        ((500, 250, 125, 60), 1),
    ],
)
def test_nominal_shutter_speeds_are_replaced_by_exact_ones(speeds: tuple[int, ...], per_stop: int) -> None:
    """Most steps between them are right, and the others look like outliers."""
    camera = Disturbed(speeds=speeds, per_stop=per_stop)
    found, observations = camera.fit(), camera.pairs()
    assert stated(found) == {"nominal exposures": pytest.approx(1, abs=0.05)}
    steps = per_stop * (observations.log_exposure + found.log_exposure_error(observations)) / np.log(2)
    assert np.ptp(steps - np.rint(steps - steps[0])) < 0.1  # whole steps apart
    assert is_right(found)
    assert abs(step_in_sigmas(found)) < 3


@pytest.mark.parametrize(("exposures", "seed"), [(4, 0), (7, 1), (12, 0), (20, 1)])
def test_errors_of_exposures_that_recur_are_not_mistaken_for_other_effects(exposures: int, seed: int) -> None:
    """The response can suit most of these errors, which leaves few pairs of frames that disagree with it."""
    speeds = tuple((1000 / TYPICAL_MS * np.exp(np.linspace(-0.8, 0.8, exposures))).tolist())
    found = Disturbed(speeds=speeds, errors=tuple(np.random.default_rng(seed).normal(0, 0.02, exposures))).fit()
    assert stated(found) == {"inexact exposures": pytest.approx(0.02, rel=0.8)}
    assert log_ratio_error(found.response(), GAMMA) < found.log_ratio_error_bound
    assert abs(step_in_sigmas(found)) < 3


def test_two_exposures_show_no_step_of_the_gain() -> None:
    """It cannot be distinguished from a power of the exposures, so it would only widen the bands."""
    pairs = Disturbed().pairs()
    of_two = replace(pairs, log_exposure=np.where(pairs.log_exposure > np.log(TYPICAL_MS), 2.5, 1.5))
    assert np.all(np.isnan(Effects.none_of(of_two).step_exposures))
    assert np.all(np.isfinite(Effects.none_of(pairs).step_exposures))


def test_levels_darker_than_the_typical_dark_signal_are_right_too() -> None:
    fit = Disturbed(dark=0.02, shortest=-3.0).fit()
    assert list(stated(fit)) == ["stray light at the corners"]
    dark, middle = fit.response().inverse([25 / 255, 128 / 255])
    true_dark, true_middle = GAMMA.inverse([25 / 255, 128 / 255])
    assert true_dark < 0.02
    assert np.log(dark / middle) == pytest.approx(np.log(true_dark / true_middle), abs=0.05)


def test_two_effects_are_distinguished() -> None:
    found = Disturbed(glare=0.03, offset=-0.05).fit()
    assert stated(found) == {
        "veiling glare": pytest.approx(0.03, rel=0.1),
        "exposure offset": pytest.approx(-0.05, rel=0.15),
    }
    assert is_right(found)


@pytest.mark.parametrize("beyond_white", [0.0, 3.0])
def test_the_glare_of_white_pixels_is_measured_and_corrected(beyond_white: float) -> None:
    found = Disturbed(glare=0.03, most_white=0.3, beyond_white=beyond_white).fit()
    unusual = 0.03 * (beyond_white - BEYOND_WHITE) * 0.3
    assert stated(found) == {
        "veiling glare": pytest.approx(0.03, rel=0.15),
        "glare of white pixels": pytest.approx(unusual, rel=0.2),
    }
    assert is_right(found)


def test_the_glare_of_a_sky_is_measured_and_corrected() -> None:
    """The light of a sky that is white in all frames is proportional to the exposure."""
    camera = Disturbed(glare=0.02, most_white=0.3, sky=2.0)
    found = camera.fit()
    assert stated(found).keys() == {"veiling glare", *GLARE_OF_WHITE}
    assert stated(found)["veiling glare"] == pytest.approx(0.02, rel=0.15)
    assert is_right(found)


@pytest.mark.parametrize("late", [0.0, 0.4])
def test_errors_of_the_exposures_are_found_beside_scattered_light(late: float) -> None:
    """If one of these effects at a time is fitted, the others may look like local tone mapping."""
    found = Disturbed(glare=0.03, scatter=0.005, most_white=0.3, offset=0.1, late=late, shortest=-2.0).fit()
    errors = {"exposure offset", "late exposures"} if late else {"exposure offset"}
    assert stated(found).keys() == {"veiling glare", "light scattered nearby", *errors}
    assert is_right(found)


def test_white_pixels_of_unknown_brightness_are_no_contradiction() -> None:
    """Where most of the light is scattered light, its error looks like another response in each frame."""
    found = Disturbed(glare=0.05, scatter=0.03, most_white=0.3, beyond_white=1.5, varying_white=1.0).fit()
    assert stated(found).keys() == {"veiling glare", "light scattered nearby", "unsteady light"}
    assert is_right(found)


@pytest.mark.parametrize(
    ("camera", "name"),
    [
        (Disturbed(glare=0.03, black_by_exposure=0.01), "black level by exposure"),
        (Disturbed(glare=0.03, black_drift=0.01), "drifting black level"),
    ],
)
def test_a_black_level_that_changes_is_found_beside_glare(camera: Disturbed, name: str) -> None:
    assert name in stated(camera.fit())


def test_points_where_the_basis_cannot_follow_the_response_prove_no_contradiction(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A response that is steep near black looks like a black level that depends on the exposure."""
    pairs = Disturbed().pairs()
    on_the_left = np.repeat(pairs.position[:, 0].reshape(-1, 2).min(axis=1) < 0, 2)
    black = np.where(on_the_left, 0.02 * (pairs.log_exposure - np.log(TYPICAL_MS)), 0.0)
    pairs = replace(pairs, grey=np.clip(pairs.grey + black, 0.0, 1.0))
    assert "black level by exposure" in stated(fit_with_chosen_effects(pairs, PLAN).fit)
    monkeypatch.setattr(Fit, "resolves", lambda _, observations: observations.position[:, 0] >= 0)
    assert "black level by exposure" not in stated(fit_with_chosen_effects(pairs, PLAN).fit)


@pytest.mark.parametrize("rise", [0.0, 0.02])
def test_light_may_drift_while_the_exposure_only_rises(rise: float) -> None:
    """The images do not show whether the light drifted, so the uncertainty allows for it."""
    ramp, both_ways = (Disturbed(rise=rise, ramp=ramp, apart=20).fit() for ramp in (True, False))
    (drift,) = (one for one in ramp.effect_estimates if one.name == "drifting light")
    assert drift.sigma == pytest.approx(0.05, rel=0.1)
    assert not drift.corrected
    assert abs(step_in_sigmas(ramp)) < 3
    assert ramp.log_response_step_sigma(0.25, 0.75) > 3 * both_ways.log_response_step_sigma(0.25, 0.75)


def test_a_drift_is_not_corrected_if_the_exposure_hardly_does_more_than_rise() -> None:
    """Small errors imitate it, which its correction would hide."""
    ramp, both_ways = (Disturbed(rise=0.2, ramp=True, jitter=jitter, apart=20).fit() for jitter in (0.15, 0.5))
    assert "drifting light" in both_ways.effects.chosen
    assert "drifting light" not in ramp.effects.chosen
    assert abs(step_in_sigmas(ramp)) < 3
    assert ramp.log_response_step_sigma(0.25, 0.75) > 3 * both_ways.log_response_step_sigma(0.25, 0.75)


@pytest.mark.parametrize("plain_is_steady", [True, False])
def test_unsteadiness_that_only_corrections_cause_is_none(
    monkeypatch: pytest.MonkeyPatch, plain_is_steady: bool
) -> None:
    unsteady = EffectEstimate("unsteady response", 0.02, 0.002, contradicts=True)
    found = iter([(unsteady,), () if plain_is_steady else (unsteady,)])
    monkeypatch.setattr("ospc.estimation.effect_choice.unsteadiness", lambda *_: next(found))
    fit = Disturbed(glare=0.03).fit(seed=5 + plain_is_steady)  # seeds of its own: fits are cached
    assert (unsteady in fit.effect_estimates) is not plain_is_steady
    assert not fit.effects.chosen
    assert not any(estimate.corrected for estimate in fit.effect_estimates)


@pytest.mark.parametrize(
    ("camera", "name"),
    [
        (Disturbed(power_of_logarithm=0.1), "curved exposures"),
        (Disturbed(tone=-0.1), "local tone mapping"),
        (Disturbed(tone=-0.02), "local tone mapping"),
        (Disturbed(gamma_drift=0.08), "drifting response"),
        (Disturbed(black_drift=0.02), "drifting black level"),
        (Disturbed(black_by_exposure=0.02), "black level by exposure"),
        (Disturbed(vignette_drift=0.08), "drifting vignette"),
        (Disturbed(vignette_by_exposure=0.05), "vignette by exposure"),
        (Disturbed(vignette_motion=(0.08, 0.0)), "vignette moving sideways"),
        (Disturbed(vignette_motion=(0.0, 0.08)), "vignette moving vertically"),
        (Disturbed(square=0.3), "square vignette"),
        (Disturbed(smudge=0.08), "uneven vignette"),
        (Disturbed(unsteady=0.05), "unsteady response"),
        (Disturbed(stabilised=0.05), "unsteady vignette"),
        (Disturbed(local=0.05), "unsteady radiance"),
    ],
)
def test_contradictions_of_the_model_are_stated_and_not_corrected(camera: Disturbed, name: str) -> None:
    found = camera.fit()
    assert name in stated(found)
    of_residuals = {"uneven vignette", "unsteady response", "unsteady vignette", "unsteady radiance"}
    assert set(stated(found)) <= {*CONTRADICTIONS, *of_residuals}
    assert not len(found.effects)


def test_local_contrast_is_reported_with_both_possible_causes() -> None:
    for tone in (-0.1, 0.1):
        told = dict(contradictions_of(Disturbed(tone=tone).fit()))
        (what,) = (text for text in told if "brightness around" in text)
        assert "local tone mapping or flickering light" in what
        assert "tone mapping" in told[what]
        assert "steady light" in told[what]


@pytest.mark.parametrize("seed", range(4))
def test_few_pairs_of_a_good_camera_show_no_contradiction(seed: int) -> None:
    assert not stated(Disturbed().fit(seed, FEW))


@pytest.mark.parametrize(
    "camera", [Disturbed(power_of_logarithm=0.2), Disturbed(unsteady=0.1), Disturbed(local=0.06)]
)
def test_few_pairs_can_contradict_the_model(camera: Disturbed) -> None:
    assert stated(camera.fit(frames=FEW))


def test_few_pairs_correct_a_clear_effect() -> None:
    found = Disturbed(offset=0.05).fit(frames=FEW)
    assert stated(found) == {"exposure offset": pytest.approx(0.05, rel=0.15)}
    assert is_right(found)


def test_an_uncertain_effect_widens_the_bands() -> None:
    found, usual = (camera.fit(frames=FEW) for camera in (Disturbed(offset=0.004), Disturbed()))
    assert not len(found.effects)
    assert found.log_response_step_sigma(0.25, 0.75) > 1.5 * usual.log_response_step_sigma(0.25, 0.75)


def test_the_uncertainty_of_a_found_effect_includes_those_left_out() -> None:
    found = Disturbed(glare=0.03).fit()
    (glare,) = (one for one in found.effect_estimates if one.corrected)
    assert found.effects.chosen == (glare.name,)
    assert glare.value == found.effect_parameters[0]
    assert glare.sigma == np.sqrt(found.covariance[found.vignette_part.stop, found.vignette_part.stop])


def step_in_sigmas(fit: Fit) -> float:
    """Return the error of the step of ln g from grey level 1/4 to 3/4, in units of its reported sigma."""
    low, high = (float(np.log(fit.response().inverse(grey) / GAMMA.inverse(grey))) for grey in (0.25, 0.75))
    return (high - low) / fit.log_response_step_sigma(0.25, 0.75)


@pytest.mark.parametrize("seed", range(3))
def test_a_contradiction_widens_the_bands_by_its_effect(seed: int) -> None:
    assert abs(step_in_sigmas(Disturbed(tone=-0.1).fit(seed))) < 1.2


def test_the_bands_of_a_vignette_that_changes_hold_that_of_the_last_frame() -> None:
    rise = 0.08
    found = Disturbed(vignette_drift=rise).fit()
    at_corner = found.log_irradiance_rows(np.zeros(1), np.array([[0.8, 0.6]]))[0, found.vignette_part]
    sigma = np.sqrt(at_corner @ found.covariance[found.vignette_part, found.vignette_part] @ at_corner)
    assert 0.8 * rise < sigma < 1.5 * rise


@pytest.mark.parametrize(
    ("camera", "shift"),
    [
        (Disturbed(gamma_drift=0.08), lambda grey: 0.08 * np.log(grey)),
        (Disturbed(black_drift=0.02), lambda grey: 0.02 / grey),
    ],
)
def test_the_bands_of_a_response_that_changes_hold_that_of_the_last_frame(
    camera: Disturbed, shift: Callable[[float], float]
) -> None:
    """``shift`` is that of the logarithm of each grey level in the last frame."""
    rises = [shift(grey) * log_slope_of_response(grey) for grey in (0.25, 0.75)]
    sigma = camera.fit().log_response_step_sigma(0.25, 0.75)
    assert 0.8 * abs(rises[1] - rises[0]) < sigma < 2.5 * abs(rises[1] - rises[0])


def log_slope_of_response(grey: float) -> float:
    """Return the derivative of ln g with respect to ln M."""
    low, high = (float(np.log(GAMMA.inverse(grey * factor))) for factor in (0.99, 1.01))
    return (high - low) / np.log(1.01 / 0.99)


@pytest.mark.parametrize(("light", "seed"), [(0.01, 0), (0.03, 0), (0.03, 1), (0.03, 2)])
def test_light_that_changes_between_frames_is_measured_without_harm_to_the_vignette(light: float, seed: int) -> None:
    found = Disturbed(light=light).fit(seed)
    assert stated(found) == {"unsteady light": pytest.approx(np.sqrt(2) * light, rel=0.3)}
    assert abs(step_in_sigmas(found)) < 3
    assert found.errors.radiance_sigma < 0.2 * light
    assert vignette_rmse(found.vignette(SIZE), POLYNOMIAL, 1.0) < 0.005


def test_the_bands_under_unsteady_light_match_the_errors() -> None:
    sigmas = np.array([step_in_sigmas(Disturbed(light=0.03).fit(seed)) for seed in range(4)])
    assert 0.4 < np.sqrt(np.mean(sigmas**2)) < 1.4


def test_slow_changes_of_light_cost_less_accuracy_than_fast_ones() -> None:
    """Slow light correlates the gains of neighbouring pairs, so each gain is known better."""
    errors = {}
    for name, scale in (("light", 0.03), ("slow_light", 0.06)):
        fits = [Disturbed(**{name: scale}).fit(seed) for seed in range(4)]
        assert all("unsteady light" in stated(fit) for fit in fits)
        errors[name] = [step_in_sigmas(fit) * fit.log_response_step_sigma(0.25, 0.75) for fit in fits]
    assert np.std(errors["slow_light"]) < 0.2 * np.std(errors["light"])


def test_unsteady_light_is_not_mistaken_for_an_exposure_offset() -> None:
    """An exposure recorded too short enters the equations twice: as the exposure and in the offset term."""
    fits = [Disturbed(light=0.03).fit(seed) for seed in range(4)]
    offset = [one for fit in fits for one in fit.effect_estimates if one.name == "exposure offset"]
    mean = np.mean([one.value for one in offset])
    assert abs(mean) < 2.5 * np.mean([one.sigma for one in offset]) / np.sqrt(len(offset))


def test_effects_are_found_although_the_light_changes() -> None:
    found = Disturbed(offset=-0.05, light=0.01).fit()
    assert stated(found).keys() == {"exposure offset", "unsteady light"}
    assert stated(found)["exposure offset"] == pytest.approx(-0.05, rel=0.3)


@pytest.mark.parametrize(("camera", "value"), [(Disturbed(glare=0.03), 0.03), (Disturbed(scatter=0.04), 0.04)])
def test_the_bands_allow_for_an_inexact_model_of_corrected_light(camera: Disturbed, value: float) -> None:
    found = camera.fit()
    (sigma,) = (one.sigma for one in found.effect_estimates if one.corrected)
    assert sigma == pytest.approx(ADDED_LIGHT_MODEL_ERROR * value, rel=0.15)
    by_chance = replace(found, covariance=found.chance)
    assert found.log_response_sigma(np.array([0.1]), 0.5) > 2 * by_chance.log_response_sigma(np.array([0.1]), 0.5)


def test_the_trial_of_a_joint_fit_leads_back_to_the_fit_without_the_effect() -> None:
    observations = Disturbed(offset=0.006).pairs()
    none = Effects.none_of(observations)
    vignette = VignetteBasis(8)
    plan = FitPlan(ResponseBasis(32), vignette, NOISE, ROUNDS)
    without, joint = (
        plan.fit(observations, vignette, effects) for effects in (none, none.including("exposure offset"))
    )
    trial = trial_of(joint)
    assert (trial.name, trial.value) == ("exposure offset", joint.parameters[-1])
    assert trial.value == pytest.approx(0.006, abs=4 * trial.sigma)
    back = joint.parameters[:-1] - trial.value * trial.parameter_slope
    sigma = np.sqrt(np.diag(without.chance))
    moved = np.abs(joint.parameters[:-1] - without.parameters) / sigma
    assert moved.max() > 1
    assert np.all(np.abs(back - without.parameters) / sigma < 0.3 * moved.max())


@pytest.mark.parametrize("offset", [-0.006, -0.003, 0.003, 0.006])
def test_a_suspected_effect_widens_the_bands(offset: float) -> None:
    assert abs(step_in_sigmas(Disturbed(offset=offset).fit(frames=FEW))) < 3


def test_an_effect_that_is_measured_does_not_widen_the_bands() -> None:
    """Without frame moments only the prior limits the glare; with them its absence is measured."""
    known = Disturbed().fit()
    sigma = {one.name: one.sigma for one in known.effect_estimates}
    assert sigma["veiling glare"] < 0.1 * EFFECTS["veiling glare"].sigma
    assert known.log_response_step_sigma(0.25, 0.75) < 0.02


@pytest.mark.parametrize("name", ["srgb", "gamma2.2", "log", "filmic"])
def test_moments_give_the_mean_irradiance(name: str) -> None:
    """The mean is right for dark and bright surroundings and for every response."""
    basis = ResponseBasis(32)
    knots = np.clip(basis.knots, 1e-3, 1 - 1e-3)
    above, below = (np.log(RESPONSES[name]().inverse(knots + step)) for step in (1e-3, -0.99e-3))
    coefficients = np.maximum(knots * (above - below) / 1.99e-3, 0.1)
    grey = np.linspace(0.1, 0.97, 40)
    everything = Disturbed().pairs()
    moments = np.column_stack([grey[:, None] ** np.arange(1, 6), np.zeros(40)])
    terms = Effects(("veiling glare",)).terms(
        replace(everything.where(slice(0, 40)), frame_moments=moments),
        ResponseTables.of(basis, coefficients),
        basis.index_of(grey),
    )
    light = np.exp(np.interp(grey, basis.grid, basis.log_of(coefficients)))
    error = (terms.amounts["veiling glare"] - light) / (light + 0.02)
    assert np.sqrt(np.mean(error**2)) < 0.03


@settings(max_examples=30)
@given(
    values=st.lists(st.floats(-0.01, 0.01), min_size=len(EFFECTS), max_size=len(EFFECTS)),
    seed=st.integers(0, 99),
)
def test_the_jacobian_is_the_derivative(values: list[float], seed: int) -> None:
    everything = Disturbed().pairs(seed)
    # At dark points the additional light may be clipped, and the analytic derivative does not apply.
    bright = everything.of_points(np.minimum.reduceat(everything.grey, everything.starts) > 0.3)
    observations = bright.where(slice(0, 40))
    basis = ResponseBasis(32)
    effects = Effects.none_of(observations).including(*EFFECTS)
    terms = effects.terms(
        observations, ResponseTables.of(basis, typical_gamma(basis.knots)), basis.index_of(observations.grey)
    )
    about = np.array(values)
    analytic = effects.jacobian(about, terms)
    for i in range(len(effects)):
        step = np.zeros(len(effects))
        step[i] = 1e-6
        numeric = (effects.log_gain(about + step, terms) - effects.log_gain(about - step, terms)) / 2e-6
        np.testing.assert_allclose(analytic[:, i], numeric, rtol=1e-4, atol=1e-6)
