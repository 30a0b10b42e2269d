"""Cached summaries of recordings of known cameras, and random ones that are quick to make."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from log_polynomials import log_polynomial
from ospc.estimation.fit_plan import FitPlan
from ospc.estimation.response_basis import ResponseBasis
from ospc.estimation.vignette_choice import fit_with_chosen_vignette
from ospc.methods.fit_inputs import FitInputs
from ospc.photometry.noise import NoiseModel
from ospc.photometry.response import Response
from ospc.pooling.summary import PARAMETERS, RESPONSE, VIGNETTE, Summary, summary_of, triangle_of
from ospc.settings.vignette import MAX_VIGNETTE_REACH
from synthetic_observations import SIZE, Camera

NOISE = NoiseModel((1 / 255) ** 2, (1.5 / 255) ** 2)
CAMERA = Camera(Response.gamma(1.7, 4097), registration_sigma_px=0.4)
OTHER_LENS = replace(CAMERA, vignette=log_polynomial(SIZE, (-0.35, 0.05, -0.2)))
OTHER_RESPONSE = replace(CAMERA, response=Response.gamma(2.2, 4097))


@cache
def inputs_of(
    camera: Camera, seed: int, groups: int = 40, points: int = 40, basis: ResponseBasis = RESPONSE
) -> FitInputs:
    """Return the fit inputs of a short recording of a camera."""
    observations = camera.pairs(seed, groups, points)
    widest = replace(VIGNETTE, reach=MAX_VIGNETTE_REACH)
    fitted = fit_with_chosen_vignette(observations, FitPlan(basis, widest, NOISE, rounds=5))
    return FitInputs(SIZE, 255, NOISE, observations, fitted, stationary=False, pairs=groups)


@cache
def fisheye_inputs_of(camera: Camera, seed: int, radius: float) -> FitInputs:
    """Return the fit inputs of a camera whose image circle has a radius, in half diagonals."""
    whole = camera.pairs(seed, groups=60, points=80)
    inside = np.logical_and.reduceat(np.linalg.norm(whole.position, axis=1) < radius, whole.starts)
    observations = whole.of_points(inside)
    vignette = replace(VIGNETTE, usable_radius=radius)
    fitted = fit_with_chosen_vignette(observations, FitPlan(RESPONSE, vignette, NOISE, rounds=5))
    return replace(inputs_of(camera, seed, groups=6), observations=observations, fitted=fitted, pairs=60)


@cache
def summary(camera: Camera, seed: int, **amount: int) -> Summary:
    """Return the summary of a short recording of a camera."""
    inputs = inputs_of(camera, seed, **amount)
    found = summary_of(inputs, f"frames {seed}", {"name": f"recording {seed}"}, 100)
    assert found is not None
    return found


def plain(key: str, frames: int = 10, seed: int = 0) -> Summary:
    """Return a random summary, which needs no estimation."""
    random = np.random.default_rng(seed)
    rows = random.standard_normal((PARAMETERS, PARAMETERS))
    matrix = rows.T @ rows
    estimate = np.concatenate([np.full(len(RESPONSE), 1.5), np.zeros(len(VIGNETTE))])
    return Summary(
        key=key,
        name=key,
        size=SIZE,
        max_grey=255,
        frames=frames,
        pairs=frames,
        points=100,
        groups=frames,
        estimate=estimate,
        triangle=triangle_of(matrix),
        vector=matrix @ estimate,
        systematic=np.zeros_like(triangle_of(matrix)),
        exposure_range_ms=(1.0, 10.0),
        radial_motion=0.5,
        stationary=False,
        support=(0.01, 0.99),
        unexplained=0.0,
        noise=NOISE,
    )
