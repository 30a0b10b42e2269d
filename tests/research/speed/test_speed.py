"""Speed measurements are complete and consistent; the speed itself is not tested."""

import json
from dataclasses import replace

import pytest
from click.testing import CliRunner

from ospc.cli.main import cli
from ospc.errors import OspcError
from ospc.recording import open_recording
from ospc.research.speed import lines, measuring
from ospc.research.speed.lines import LARGE, VGA, goal_of, row_of, speed_report, speed_tasks
from ospc.research.speed.measuring import calibrate_command, calibrating, correct_command, correcting, live
from ospc.research.speed.reel import reel_of

SIZE = (128, 96)


@pytest.fixture(scope="module")
def reel():
    return reel_of(SIZE, 12)


@pytest.fixture(scope="module")
def rows(reel):
    return [
        *(calibrating(SIZE, reel, name, 20) for name in ("default", "fast")),
        live(SIZE, reel, 0.2, 50),
        calibrate_command(SIZE, reel, 20),
        correct_command(SIZE, reel, 5),
        correcting(SIZE, reel, "uint8"),
    ]


def test_frames_go_forth_and_back(reel):
    assert [reel.place(i) for i in range(25)] == [*range(12), *range(10, -1, -1), 1, 2]
    shown = list(reel.frames(25))
    assert [f.index for f in shown] == list(range(25))
    assert shown[0].image.shape == SIZE[::-1]
    assert shown[23].exposure_ms == shown[1].exposure_ms


def test_a_reel_is_written_as_the_recording_that_it_shows(reel, tmp_path):
    written = list(open_recording(reel.write(tmp_path / "recording", 30)))
    for frame, shown in zip(written, reel.frames(30), strict=True):
        assert (frame.image == shown.image).all()
        assert frame.exposure_ms == pytest.approx(shown.exposure_ms)


def test_figures_are_those_of_the_run(rows):
    for row in rows:
        assert row.push_ms is None or row.push_ms[0] <= row.push_ms[1] <= row.push_ms[2]
        assert row.frames_per_second == pytest.approx(row.frames / row.seconds)
        assert min(row.cpu_s, row.against_s, row.against_cpu_s) > 0
    assert [row.frames for row in rows] == [20, 20, 10, 20, 5, 40]
    assert "processed" in rows[2].notes
    assert all(row.peak_mb > 10 for row in rows[:5])


def test_the_table_and_the_files_hold_every_row(rows, tmp_path):
    report = speed_report(rows)
    (table,) = report.tables
    assert [row[0] for row in table.rows] == [row.what for row in rows]
    assert all(len(row) == len(table.header) for row in table.rows)
    written = report.write(tmp_path)
    assert [path.name for path in written] == ["results.json", "results.csv", "table.md"]
    content = json.loads(written[0].read_text())
    assert content == json.loads(json.dumps(report.content))
    assert content["rows"][0]["ratio"] == pytest.approx(rows[0].seconds / rows[0].against_s)


def test_a_row_survives_the_store(rows):
    for row in rows:
        assert row_of(json.loads(json.dumps(vars(row)))) == row


def test_goals_are_judged_only_at_the_size_and_length_they_are_for(rows):
    tasks = [task.name for task in speed_tasks(("default",), (VGA, LARGE), 1500, 30.0, 30.0)]
    assert [name for name in tasks if name.startswith("ospc calibrate")] == [
        "ospc calibrate, 100 frames, 640×480",
        "ospc calibrate, 500 frames, 640×480",
        "ospc calibrate, 600 frames, 1280×1024",
        "ospc calibrate, 1500 frames, 1280×1024",
    ]

    def met(row, **changes):
        return goal_of(replace(row, **changes))[1]

    quick = replace(rows[3], size=VGA, frames=500)
    assert met(quick, seconds=2.9) is True
    assert met(quick, seconds=3.1) is False
    long = replace(rows[3], size=LARGE, frames=1500, against_s=10.0)
    assert met(long, seconds=6.0) is True
    assert met(long, seconds=8.0) is False
    easy = replace(rows[2], what="live, 30 frames/s", size=VGA, seconds=10.0, cpu_s=2.4)
    assert met(easy, peak_mb=140.0) is True
    assert met(easy, peak_mb=160.0) is False
    assert met(easy, peak_mb=140.0, what="live, 20 frames/s") is None
    assert met(quick, frames=50) is None
    assert all(goal_of(row) == ("", None) for row in rows)


def test_the_command_continues_where_it_stopped(tmp_path, monkeypatch):
    # Each measurement has a process of its own; some are enough.
    some = ("preset", "live", "correcting in memory to uint8")
    monkeypatch.setattr(lines, "speed_tasks", lambda *how: [t for t in speed_tasks(*how) if t.name.startswith(some)])
    arguments = ["bench", "speed", "-o", str(tmp_path), "--size", "64x48", "--frames", "3", "--presets", "fast"]
    first = CliRunner().invoke(cli, [*arguments, "--live", "0"])
    assert first.exit_code == 0, first.output
    before = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "cache").iterdir()}
    again = CliRunner().invoke(cli, [*arguments, "--live", "0.1"])
    after = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "cache").iterdir()}
    assert again.exit_code == 0, again.output
    assert before.items() < after.items()
    assert len(after) == len(before) + 1


def test_a_command_that_fails_has_no_time(tmp_path):
    with pytest.raises(OspcError, match="ospc calibrate failed with exit code 1"):
        measuring._called("calibrate", str(tmp_path / "nothing"), "-o", str(tmp_path / "out"))


@pytest.mark.parametrize("arguments", [["--size", "7x7"], ["--size", "huge"], ["--presets", "hasty"]])
def test_what_makes_no_sense_is_refused(arguments, tmp_path):
    result = CliRunner().invoke(cli, ["bench", "speed", "-o", str(tmp_path / "out"), *arguments])
    assert result.exit_code != 0
    assert not (tmp_path / "out").exists()
