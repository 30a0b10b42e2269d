"""The set of recordings is fixed, large enough and balanced."""

from __future__ import annotations

from collections import Counter
from itertools import product

import numpy as np
import pytest
from scipy.io import savemat

from ospc.errors import FormatError, SettingError
from ospc.research.accuracy.design import FILE, accuracy_sources, select


@pytest.fixture
def moving():
    cases, _ = accuracy_sources(None)
    return [case for case in cases if case.group == "simulated"]


def levels(cases, *names):
    return Counter(tuple(case.factors[name] for name in names) for case in cases)


def test_is_large_and_every_name_and_seed_is_its_own(moving):
    assert len(moving) >= 24
    assert len({case.name for case in moving}) == len(moving)
    assert len({case.settings.seed for case in moving}) == len(moving)
    assert all(case.settings.frames == 500 and case.settings.size == (640, 480) for case in moving)


def test_every_response_meets_every_vignette(moving):
    met = levels(moving, "response", "vignette")
    responses, vignettes = ({case.factors[name] for case in moving} for name in ("response", "vignette"))
    assert len(vignettes) == 4
    assert {"linear", "srgb", "log", "filmic", "tum_narrow"} <= responses
    assert all(met[pair] >= 1 for pair in product(responses, vignettes))


def test_every_named_response_meets_noise_and_moving_objects_in_all_combinations(moving):
    for response in ("linear", "srgb", "log", "filmic", "tum_narrow"):
        found = levels([c for c in moving if c.factors["response"] == response], "noise", "scene")
        assert sorted(found.values()) == [1, 1, 1, 1]


def test_every_vignette_meets_noise_and_moving_objects_in_equal_number(moving):
    for vignette in {case.factors["vignette"] for case in moving}:
        members = [c for c in moving if c.factors["vignette"] == vignette]
        for pairs in (levels(members, "noise"), levels(members, "scene")):
            assert max(pairs.values()) - min(pairs.values()) <= 1
        assert len(levels(members, "noise", "scene")) == 4


def test_gamma_curves_replace_measured_responses_with_a_note(moving, tmp_path):
    assert sum(case.name.startswith("gamma") for case in moving) == 8
    _, notes = accuracy_sources(None)
    assert any("gamma curves" in note for note in notes)
    _, notes = accuracy_sources(tmp_path)
    assert sum("does not exist" in note for note in notes) == 3


def test_measured_responses_are_chosen_the_same_way_each_time(tmp_path):
    light = np.linspace(0, 1, 1024)
    curves = np.array([light ** (1 / (1 + i / 10)) for i in range(20)])
    (tmp_path / FILE).parent.mkdir()
    savemat(tmp_path / FILE, {"I": np.tile(light, (20, 1)), "B": curves})
    first, again = (
        [c.name for c in accuracy_sources(tmp_path)[0] if c.name.startswith("measured")] for _ in range(2)
    )
    assert len(first) == 8
    assert first == again


def test_a_folder_of_charts_without_cameras_is_refused(tmp_path):
    (tmp_path / "chart_cameras").mkdir()
    with pytest.raises(FormatError, match="no folder with"):
        accuracy_sources(tmp_path)


def test_real_data_gives_a_video_and_three_channels_a_camera(real_data):
    cases, _ = accuracy_sources(real_data)
    groups = Counter(case.group for case in cases)
    if (real_data / "chart_cameras").is_dir():
        assert groups["charts"] == 3 * len([p for p in (real_data / "chart_cameras").iterdir() if p.is_dir()])
    assert groups["video"] == int((real_data / "borealhdr_left").is_dir())


def test_recordings_are_selected_by_name(moving):
    by_name = {case.name: case for case in moving}
    assert select(by_name, None) == moving
    assert {c.factors["response"] for c in select(by_name, "srgb-*")} == {"srgb"}
    assert {c.factors["vignette"] for c in select(by_name, "weak")} == {"weak"}
    with pytest.raises(SettingError, match="known: linear-strong"):
        select(by_name, "nothing-like-it")
