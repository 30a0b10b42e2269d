"""How long a suspicion is followed: in time, whatever the frame rate."""

from __future__ import annotations

import numpy as np
import pytest

from ospc.methods.change_detection import ChangeDetector
from ospc.settings.methods import MIN_FRAME_RATE


@pytest.mark.parametrize(("rate", "counted"), [(5.0, 20.0), (20.0, 20.0), (50.0, 50.0), (1000.0, 100.0)])
def test_times_are_counted_in_frames_by_the_stamps(rate, counted):
    detector = ChangeDetector()
    for number in range(3, 400, 7):
        detector.observe_time(number, 1.7e9 + number / rate)
    assert detector.frames_per_s == pytest.approx(counted, rel=1e-6)


@pytest.mark.parametrize("stamps", [[0.0] * 5, [np.nan] * 5, [5.0, 4.0, 3.0, 2.0, 1.0]])
def test_stamps_that_are_none_count_as_those_of_slow_film(stamps):
    detector = ChangeDetector()
    for number, stamp_s in enumerate(stamps):
        detector.observe_time(number, stamp_s)
    assert detector.frames_per_s == MIN_FRAME_RATE
