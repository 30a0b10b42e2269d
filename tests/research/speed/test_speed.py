"""Measurements of speed: everything measured is there and adds up; how fast it is, a test cannot say."""

import json

import pytest
from click.testing import CliRunner

from ospc.cli.main import cli
from ospc.correspondence.preprocessing import Preprocessor
from ospc.research.speed.measuring import Reel, run, run_live
from ospc.research.speed.report import content_of, table_of, write_speed
from ospc.research.speed.stages import OTHER, clocks

SIZE = (128, 96)


@pytest.fixture(scope="module")
def reel():
    return Reel.simulated(SIZE, 12)


@pytest.fixture(scope="module")
def rows(reel):
    return [run("default", SIZE, reel, 20), run("fast", SIZE, reel, 20), run_live(SIZE, reel, 0.2, 50)]


def test_frames_go_forth_and_back(reel):
    assert [reel.place(i) for i in range(25)] == [*range(12), *range(10, -1, -1), 1, 2]
    shown = list(reel.frames(25))
    assert [f.index for f in shown] == list(range(25))
    assert shown[0].image.shape == SIZE[::-1]
    assert shown[23].exposure_ms == shown[1].exposure_ms


def test_stages_add_up_to_the_whole(rows):
    for row in rows[:2]:
        assert sum(row.stages.values()) == pytest.approx(row.seconds, rel=1e-6)
        assert {"preparing", "registering", "sampling", OTHER} <= set(row.stages)
        assert all(seconds >= 0 for seconds in row.stages.values())


def test_figures_are_those_of_the_run(rows):
    for row in rows:
        assert row.push_ms[0] <= row.push_ms[1] <= row.push_ms[2]
        assert row.frames_per_second == pytest.approx(row.frames / row.seconds)
        assert row.peak_mb > 10
    assert [row.frames for row in rows] == [20, 20, 10]
    assert "processed" in rows[2].notes


def test_clocks_are_taken_away_again():
    before = Preprocessor.__call__
    with clocks():
        assert Preprocessor.__call__ is not before
    assert Preprocessor.__call__ is before


def test_table_json_and_picture_hold_every_row(rows, tmp_path):
    table = table_of(rows)
    assert [row[0] for row in table.rows] == ["default", "fast", "live"]
    assert all(len(row) == len(table.header) for row in table.rows)
    written = write_speed(tmp_path, rows)
    assert [path.name for path in written] == ["speed.json", "speed.png"]
    content = json.loads(written[0].read_text())
    assert content == json.loads(json.dumps(content_of(rows)))
    assert content["rows"][0]["over_decoding"] == pytest.approx(rows[0].seconds / rows[0].decoding_s)


@pytest.mark.parametrize("arguments", [["--size", "7x7"], ["--size", "huge"], ["--presets", "hasty"]])
def test_what_makes_no_sense_is_refused(arguments, tmp_path):
    result = CliRunner().invoke(cli, ["bench", "speed", "-o", str(tmp_path / "out"), *arguments])
    assert result.exit_code != 0
    assert not (tmp_path / "out").exists()
