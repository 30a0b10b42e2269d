"""Watching: known once, compared from then on, estimated anew after a change; the same for the same frames."""

import numpy as np
import pytest

from ospc.errors import OspcError, SettingError
from ospc.live import Watch
from ospc.live.watch import WATCHING_PAUSE
from ospc.recording import Frame


@pytest.fixture(scope="module")
def watched(cameras):
    """A watch that saw a camera until all was known, then a while longer, then another lens."""
    watch = Watch()
    states = []
    for frame in [*cameras.before, *cameras.before[::-1][:60], *cameras.after, *cameras.after[::-1]]:
        assert watch.look(frame)
        states.append((watch.watching, watch.changes, watch.notes))
    return watch, states


def test_an_unchanged_camera_is_known_and_stays_so(watched, cameras):
    _, states = watched
    known, changes, notes = states[len(cameras.before) + 59]
    assert known
    assert changes == 0
    assert len(notes) == 1
    assert "known" in notes[0]


def test_another_lens_is_noticed_said_and_calibrated_anew(watched, cameras):
    watch, states = watched
    assert states[-1][1] == 1
    assert [note for note in watch.notes if "changed" in note and ("lens" in note or "camera" in note)]
    truth_after = watch.estimate().vignette
    assert truth_after is not None
    corner = np.array([[319.0, 239.0]])
    assert truth_after.at(corner)[0] < 0.65  # 0.45 for this lens, 0.85 for the one before


def test_once_known_it_looks_rarely():
    watch = Watch()
    assert watch.pause == 0
    watch._begin(object())
    assert watch.pause == WATCHING_PAUSE


def test_the_same_frames_give_the_same_notes_and_calibration(cameras):
    def run():
        watch = Watch()
        for frame in cameras.before[:50]:
            watch.look(frame)
        return watch.notes, watch.estimate().response.inverse_table

    (notes, table), (again, same) = run(), run()
    assert notes == again
    np.testing.assert_array_equal(table, same)


def test_frames_that_cannot_be_used_do_not_count(cameras):
    watch = Watch()
    assert not watch.look(Frame.of_array(np.zeros((8, 8), np.uint8), float("nan")))
    assert watch.pause == 0
    with pytest.raises(OspcError, match="no frame could be used"):
        watch.estimate()


def test_the_slow_preset_is_refused():
    with pytest.raises(SettingError, match="paper"):
        Watch("paper")
