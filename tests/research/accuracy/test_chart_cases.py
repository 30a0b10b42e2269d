"""Photographs of a chart: RAW recovers exposures and the true response; broken folders raise errors."""

from __future__ import annotations

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from ospc.errors import FormatError
from ospc.evaluation.metrics import response_shape_rmse
from ospc.photometry.response import Response
from ospc.research.accuracy.charts import CHANNELS, ChartSource, chart_sources, read_series, true_response
from ospc.research.accuracy.design import PresetMethods
from ospc.research.source import loaded, measuring_task

PATCH = 40
RESPONSE = Response.gamma(2.0, 4097)
NEUTRAL = np.array([0.9, 0.45, 0.24, 0.13, 0.07, 0.03])
WHITE_BALANCE = np.array([0.8, 1.0, 0.7])


def write_chart(data, exposures=(1.0, 2.0, 4.0, 8.0)):
    """Write noisy images of a camera whose JPEG is f(white balance · RAW); return the data folder."""
    folder = data / "chart_cameras" / "camera"
    folder.mkdir(parents=True)
    random = np.random.default_rng(0)
    colours = random.uniform(0.02, 0.8, (18, 3)).tolist() + [[v] * 3 for v in NEUTRAL]
    radiance = np.array(colours).reshape(4, 6, 1, 1, 3).repeat(PATCH, 2).repeat(PATCH, 3)
    radiance = radiance.transpose(0, 2, 1, 3, 4).reshape(4 * PATCH, 6 * PATCH, 3)
    for illuminant, light in ((1, np.ones(3)), (2, np.array([0.7, 1.0, 1.2]))):
        for number, exposure in enumerate(exposures, start=1):
            irradiance = radiance * light * exposure / 8.0
            noisy = irradiance + 0.004 * random.standard_normal(irradiance.shape)
            images = {
                "raw": np.clip(noisy / WHITE_BALANCE, 0, 1),
                "jpg": RESPONSE(np.clip(noisy * 1.05, 0, 1)),
            }
            for kind, image in images.items():
                place = folder / f"wb1i{illuminant}e{number}-{kind}.png"
                cv2.imwrite(str(place), np.rint(image * 255).astype(np.uint8))
    places = [{"position": {"x": (c + 0.5) / 6, "y": (r + 0.5) / 4}} for r in range(4) for c in range(6)]
    (folder.parent / "tags.json").write_text(json.dumps([{"references": places}]))
    return data


def measure(source, preset):
    return loaded(measuring_task(source, PresetMethods(preset)).compute(lambda _share: None))


@pytest.fixture(scope="module")
def chart(tmp_path_factory):
    return write_chart(tmp_path_factory.mktemp("data"), exposures=(1.0, 2.1, 4.0, 7.0))


def test_raw_gives_the_exposures(chart):
    for illuminant in (1, 2):
        exposures, _ = read_series(chart / "chart_cameras" / "camera", illuminant).irradiance()
        assert exposures == pytest.approx([1.0, 2.1, 4.0, 7.0], rel=0.02)


@pytest.mark.parametrize("channel", range(3))
def test_jpeg_against_raw_gives_the_response(chart, channel):
    response, greys = true_response(read_series(chart / "chart_cameras" / "camera", 1), channel)
    assert greys[0] < 40
    assert greys[1] > 200
    assert response_shape_rmse(response, RESPONSE, *greys) < 0.01


def test_both_presets_are_judged_and_their_limits_reported(chart):
    cases = chart_sources(chart / "chart_cameras")
    assert [case.factors["channel"] for case in cases] == list(CHANNELS)
    rows = {row.method: row for preset in ("default", "paper") for row in measure(cases[1], preset)}
    assert list(rows) == ["default", "paper"]
    limits = rows["paper"].limits
    assert limits["worst_exposure_error_percent"] == pytest.approx(12.5, abs=2)
    assert limits["truth_uncertainty"] < 0.02


def test_a_case_is_recognised_by_its_pixels(chart, tmp_path):
    case = chart_sources(chart / "chart_cameras")[0]
    assert case.describe() == case.describe()
    assert case.describe() != replace(case, channel=2).describe()
    other = chart_sources(write_chart(tmp_path) / "chart_cameras")[0]
    assert case.describe() != other.describe()


@pytest.mark.parametrize(
    "tags",
    ["", "{", "[]", '[{"references": []}]', '[{"references": [{"position": {"x": 5, "y": 0.5}}]}]', "[" * 10_000],
)
def test_broken_tags_are_errors(tmp_path, tags):
    data = write_chart(tmp_path)
    (data / "chart_cameras" / "tags.json").write_text(tags)
    with pytest.raises(FormatError, match=r"tags\.json"):
        read_series(data / "chart_cameras" / "camera", 1)


def test_missing_and_differing_photographs_are_errors(tmp_path):
    folder = write_chart(tmp_path) / "chart_cameras" / "camera"
    place = folder / "wb1i1e3-raw.png"
    cv2.imwrite(str(place), np.zeros((10, 10, 3), np.uint8))
    with pytest.raises(FormatError, match="differ in size"):
        read_series(folder, 1)
    place.unlink()
    with pytest.raises(FormatError, match="No such file"):
        read_series(folder, 1)


def test_black_photographs_have_no_response(tmp_path):
    folder = write_chart(tmp_path, exposures=(1e-4, 1e-4, 1e-4, 1e-4)) / "chart_cameras" / "camera"
    with pytest.raises(FormatError, match="well exposed"):
        true_response(read_series(folder, 1), 0)


def test_a_real_camera(real_data):
    folder = real_data / "chart_cameras" / "NikonD200"
    if not folder.is_dir():
        pytest.skip(f"no photographs of charts at {folder}")
    exposures, _ = read_series(folder, 1).irradiance()
    assert exposures == pytest.approx([1, 2, 4, 8], rel=0.05)
    for row in measure(ChartSource.of(folder, 1), "paper"):
        assert row.limits["truth_uncertainty"] < 0.005
        assert row.failure == ""
