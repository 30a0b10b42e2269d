"""Methods for a static camera: near the truth, and equal to independent solutions."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import isotonic_regression

from ospc.errors import NotObservableError
from ospc.evaluation.metrics import log_ratio_error, response_rmse
from ospc.photometry.response import Response
from ospc.recording.frame import Frame
from ospc.research.rivals.camera_at_rest import AT_REST, debevec_malik, robertson, sampled, series_of
from ospc.simulation.responses import srgb


def filmed(response: Response, exposures=(1, 1.6, 2.5, 4, 6.3, 10, 16), noise=0.4, size=(48, 64)):
    """Return images and exposures."""
    random = np.random.default_rng(1)
    radiance = np.exp(random.uniform(np.log(0.002), np.log(0.9), size))
    images = [255 * response(np.minimum(radiance * e, 1)) + noise * random.normal(size=size) for e in exposures]
    return np.clip(np.rint(images), 0, 255).astype(np.uint8), np.array(exposures, dtype=float)


@pytest.fixture(scope="module")
def series():
    return filmed(srgb())


@pytest.mark.parametrize("method", AT_REST.values())
def test_the_response_is_found(series, method):
    found = method(*series)
    assert response_rmse(found, srgb()) < 0.03
    assert log_ratio_error(found, srgb()) < 0.1


@pytest.mark.parametrize("method", AT_REST.values())
def test_the_unit_of_exposures_does_not_matter(series, method):
    images, exposures_ms = series
    tables = [method(images, factor * exposures_ms).inverse_table for factor in (1, 1000)]
    np.testing.assert_allclose(tables[0], tables[1], atol=2e-4)


def test_debevec_and_malik_by_their_linear_system(series):
    """Sets up and solves the published equations independently for the same pixels."""
    images, exposures_ms = series
    grey = sampled(images, 80)
    count, pixels = grey.shape
    weight = np.minimum(np.arange(256) + 1, 256 - np.arange(256)).astype(float)
    rows, targets = [], []
    for i in range(count):
        for p in range(pixels):
            row = np.zeros(256 + pixels)
            w = weight[grey[i, p]]
            row[grey[i, p]], row[256 + p] = w, -w
            rows.append(row)
            targets.append(w * np.log(exposures_ms[i] / exposures_ms.mean()))
    middle = np.zeros(256 + pixels)
    middle[128] = 1
    rows.append(middle)
    targets.append(0.0)
    for z in range(1, 255):
        row = np.zeros(256 + pixels)
        row[z - 1 : z + 2] = 10 * weight[z] * np.array([1, -2, 1])
        rows.append(row)
        targets.append(0.0)
    solved = np.exp(np.linalg.lstsq(np.array(rows), np.array(targets), rcond=None)[0][:256])
    found = debevec_malik(*series, samples=80).inverse_table
    inner = slice(5, 236)
    solved[3:251] = isotonic_regression(solved[3:251]).x
    scale = found[inner] @ solved[inner] / (solved[inner] @ solved[inner])
    np.testing.assert_allclose(found[inner], scale * solved[inner], atol=0.003)


def test_robertson_by_its_own_turns(series):
    """Alternates between radiances and the curve with the published weights, in double precision."""
    images, exposures_ms = series
    grey = images.reshape(len(images), -1)
    t = (exposures_ms / exposures_ms.mean())[:, None]
    level = np.arange(256)
    weight = (np.exp(4 - 4 * (level - 127.5) ** 2 / 127.5**2) - 1) / (np.exp(4) - 1)
    table = np.linspace(0, 2, 256)
    for _ in range(60):
        radiance = (weight[grey] * t * table[grey]).sum(0) / (weight[grey] * t**2).sum(0)
        sums = np.bincount(grey.ravel(), weights=(t * radiance).ravel(), minlength=256)
        counts = np.bincount(grey.ravel(), minlength=256)
        table = np.where(counts > 0, sums / np.maximum(counts, 1), table)
        table /= table[128]
    found = robertson(*series).inverse_table
    known = np.flatnonzero((counts > 0) & (level >= 3) & (level <= 250))
    table[known] = isotonic_regression(table[known]).x
    inner = known[10:-5]
    scale = found[inner] @ table[inner] / (table[inner] @ table[inner])
    np.testing.assert_allclose(found[inner], scale * table[inner], atol=0.01)


def test_frames_are_chosen_over_the_whole_range_of_exposures():
    frames = [
        Frame.of_array(np.full((4, 4), i, np.uint8), exposure_ms=float(e), index=i)
        for i, e in enumerate(np.geomspace(1, 100, 60))
    ]
    chosen = series_of(frames, most=10)
    assert len(chosen) == 10
    assert [chosen[0].exposure_ms, chosen[-1].exposure_ms] == [1, 100]


def test_uninformative_series_are_refused(series):
    with pytest.raises(NotObservableError, match="change"):
        robertson(series[0], np.ones(7))
    with pytest.raises(NotObservableError):
        robertson(np.zeros((2, 8, 8), np.uint8), np.array([1.0, 2.0]))
