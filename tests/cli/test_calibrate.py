from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from functools import partial

import numpy as np
import pytest

from calibrations import SIZE, calibration
from command_line import leave_out, ospc
from ospc.calibrator import OnlineCalibrator
from ospc.cli.calibration_result import say_verdicts
from ospc.engine.state import Epoch
from ospc.errors import FrameError, OspcError
from ospc.formats.dso import read_pcalib, read_vignette, write_pcalib, write_vignette
from ospc.methods.method import Progress
from ospc.photometry.calibration import Calibration
from ospc.photometry.verdict import Verdict
from ospc.recording import open_recording
from ospc.recording.exposure_lists import read_times
from ospc.settings import DefaultSettings
from ospc.simulation import SimulationSettings, simulate

FRAMES = 12
IN_MAIN_THREAD = threading.current_thread() is threading.main_thread()


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """A recording too short for an estimate."""
    place = tmp_path_factory.mktemp("simulated") / "r"
    simulate(place, SimulationSettings(size=SIZE, frames=FRAMES))
    return place


class Method:
    """A method that returns a given result and calls or raises what a test sets for a frame or the end."""

    answer = calibration(counts={"pairs": 3, "samples": 100})
    at_frame: dict[int, object] = {}  # noqa: RUF012 (replaced by tests, never changed)
    at_the_end = None

    longest_pause = 0

    def push(self, frame, prepared, exposures):
        happening = self.at_frame.get(frame.index)
        if isinstance(happening, BaseException):
            raise happening
        if happening:
            happening()

    def compare(self, brightness, exposures):
        return None

    def inputs(self, exposures, grey_range):
        return None

    def state(self):
        return None

    @property
    def progress(self):
        return Progress(3, 100, 0.1, 0.2)

    def calibration(self, exposures, grey_range):
        happening = type(self).at_the_end
        if isinstance(happening, BaseException):
            raise happening
        if happening:
            happening()
        return self.answer


@pytest.fixture
def method(monkeypatch):
    """Replace the real method and disable drawing; tests set the class attributes."""

    class OfThisTest(Method):
        pass

    monkeypatch.setattr(DefaultSettings, "build", lambda *_arguments: OfThisTest())
    monkeypatch.setattr(DefaultSettings, "state_type", lambda _settings: None)
    leave_out(monkeypatch, "draw", "report")
    return OfThisTest


run = partial(ospc, "calibrate")


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def stored(folder):
    return json.loads((folder / "calibration.json").read_text())


@pytest.fixture(scope="module")
def good_recording(tmp_path_factory):
    """A small recording that determines the response and the vignette."""
    place = tmp_path_factory.mktemp("simulated") / "good"
    # Not periodic: in a periodic sequence, more than one lag would match.
    exposures = tuple(np.random.default_rng(0).choice([3.0, 6.0, 12.0, 24.0], 48).tolist())
    simulate(place, SimulationSettings(size=(240, 180), frames=48, exposure="file", exposures_ms=exposures))
    return place


def test_a_good_recording_becomes_a_complete_output_near_the_truth(good_recording, tmp_path):
    result = run(good_recording, "-o", tmp_path / "out", "--json", "--truth", good_recording)
    assert result.exit_code == 0, result.output
    summary = json.loads(result.stdout)
    out = tmp_path / "out"
    assert summary["exit_code"] == 0
    assert (summary["partial"], summary["error"]) == (False, None)
    assert summary["errors"]["response_shape_rmse"] < 0.02
    assert summary["errors"]["vignette_rmse"] < 0.02
    assert sorted(summary["files"]) == sorted(str(path) for path in out.iterdir())
    assert read_pcalib(out / "pcalib.txt").inverse_table.size == 256
    assert read_vignette(out / "vignette.png").size == (240, 180)
    np.testing.assert_allclose(
        read_times(out / "times.txt").exposures_ms, open_recording(good_recording).exposures_ms, rtol=1e-6
    )
    content = Calibration.load(out)
    assert content.source["name"] == "good"
    assert content.settings["preset"] == "default"


def test_the_output_states_verdict_reason_and_folder(recording, tmp_path, method):
    result = run(recording, "-o", tmp_path / "out")
    assert result.exit_code == 3  # too few frames to confirm that the exposures match
    for expected in ("response", "vignette", "identifiable", "it was seen", str(tmp_path / "out"), "pcalib.txt"):
        assert expected in result.stdout


def test_a_change_of_the_camera_does_not_lose_the_calibration_before_it(recording, tmp_path, method, monkeypatch):
    epochs = (Epoch(0, 3, calibration(max_grey=255), None), Epoch(4, 7, None, None))
    monkeypatch.setattr(OnlineCalibrator, "epochs", epochs)
    result = run(recording, "-o", tmp_path / "out")
    assert "frames_0-3/pcalib.txt" in " ".join(result.stdout.split())
    assert Calibration.load(tmp_path / "out" / "frames_0-3") == epochs[0].calibration


def test_the_output_says_a_warning_and_a_remedy_once(capsys: pytest.CaptureFixture[str]) -> None:
    doubted = Verdict("marginal", "known to 2%, but the vignette moves", "lock the zoom")
    say_verdicts({"response": doubted, "vignette": doubted}, ["the vignette moves"])
    words = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert words.count("known to 2%, but see the warning") == 2
    assert words.count("the vignette moves") == 0
    assert words.count("→ lock the zoom") == words.count("→ as for the response") == 1


@pytest.mark.parametrize("part", ["response", "vignette"])
def test_undetermined_parts_give_exit_code_3_with_reason_and_remedy(recording, tmp_path, method, part):
    method.answer = calibration(**{part: False})
    result = run(recording, "-o", tmp_path / "out")
    assert result.exit_code == 3
    assert "nothing moved" in result.stdout
    assert "→ move" in result.stdout
    assert {"response": "pcalib.txt", "vignette": "vignette.png"}[part] not in names(tmp_path / "out")


def test_quiet_prints_nothing(recording, tmp_path, method):
    result = run(recording, "-o", tmp_path / "out", "--quiet")
    assert (result.exit_code, result.output) == (3, "")
    assert "calibration.json" in names(tmp_path / "out")


def test_json_is_one_document_with_everything(recording, tmp_path, method):
    method.answer = calibration(vignette=False)
    result = run(recording, "-o", tmp_path / "out", "--json")
    summary = json.loads(result.stdout)
    assert result.exit_code == summary["exit_code"] == 3
    assert summary["verdicts"]["vignette"] == {
        "state": "not identifiable",
        "reason": "nothing moved",
        "remedy": "move",
    }
    assert result.stderr == ""


def test_skipped_frames_are_counted_with_the_first_reasons(recording, tmp_path, method):
    method.at_frame = {i: FrameError(f"frame {i} is torn") for i in (2, 4, 6, 8)}
    result = run(recording, "-o", tmp_path / "out")
    assert result.exit_code == 3
    assert "note: 4 of 12 frames skipped: frame 2 is torn; frame 4 is torn; frame 6 is torn; …" in result.stderr


def test_errors_against_a_known_calibration(recording, tmp_path, method):
    truth = tmp_path / "truth"
    truth.mkdir()
    write_pcalib(method.answer.response, truth / "pcalib.txt")
    write_vignette(method.answer.vignette, truth / "vignette.png")
    result = run(recording, "-o", tmp_path / "out", "--truth", truth)
    assert "response, RMSE of g                        0.0000" in result.stdout
    method.answer = calibration(response=False)
    (truth / "vignette.png").unlink()
    result = run(recording, "-o", tmp_path / "out", "--truth", truth)
    assert result.exit_code == 3
    assert "nothing to compare" in result.stdout


def test_settings_can_be_changed_and_are_recorded(recording, tmp_path):
    run(recording, "-o", tmp_path / "out", "--set", "max_points=500", "--set", "smoothing_px = 1.25")
    settings = stored(tmp_path / "out")["settings"]
    assert (settings["max_points"], settings["smoothing_px"]) == (500, 1.25)


@pytest.mark.parametrize(
    "options",
    [
        ["--preset", "best"],
        ["--set", "max_points"],
        ["--set", "max_points=many"],
        ["--set", "no_such=1"],
        ["--set", "registration=none"],
        ["--kind", "papyrus"],
        ["--colour"],
    ],
)
def test_wrong_usage_is_exit_code_2_and_writes_nothing(recording, tmp_path, options):
    result = run(recording, "-o", tmp_path / "out", *options)
    assert result.exit_code == 2
    assert not (tmp_path / "out").exists()


def _empty(place):
    place.mkdir()


def _text_file(place):
    place.write_text("no recording")


def _text_folder(place):
    place.mkdir()
    (place / "readme.md").write_text("hello")


def _one_line_too_few(place):
    simulate(place, SimulationSettings(size=SIZE, frames=4))
    lines = (place / "times.txt").read_text().splitlines()
    (place / "times.txt").write_text("\n".join(lines[:-1]))


def _no_image_readable(place):
    simulate(place, SimulationSettings(size=SIZE, frames=4))
    for image in (place / "images").iterdir():
        image.write_bytes(b"\x89PNG\r\n\x1a\n")


def _archive_cut_off(place):
    simulate(place, SimulationSettings(size=SIZE, frames=4, archive=True))
    archive = place / "images.zip"
    archive.write_bytes(archive.read_bytes()[:2000])


@pytest.mark.parametrize(
    "make",
    [lambda _place: None, _empty, _text_file, _text_folder, _one_line_too_few, _no_image_readable, _archive_cut_off],
)
def test_wrong_input_is_a_one_line_error_that_names_it(tmp_path, make):
    make(tmp_path / "input")
    result = run(tmp_path / "input", "-o", tmp_path / "out")
    assert result.exit_code == 1
    assert isinstance(result.exception, OspcError)
    assert str(tmp_path / "input") in str(result.exception)
    assert "\n" not in str(result.exception)
    assert not (tmp_path / "out").exists()


def test_an_invalid_truth_is_refused_before_the_run(recording, tmp_path, method):
    result = run(recording, "-o", tmp_path / "out", "--truth", tmp_path / "none")
    assert isinstance(result.exception, OspcError)
    assert not (tmp_path / "out").exists()


class TestFailures:
    def test_an_unexpected_failure_keeps_the_result_so_far(self, recording, tmp_path, method):
        method.at_frame = {7: ZeroDivisionError("oh\nno")}
        result = run(recording, "-o", tmp_path / "out")
        assert isinstance(result.exception, OspcError)
        assert str(result.exception) == "unexpected ZeroDivisionError: oh no"
        assert stored(tmp_path / "out")["partial"] is True
        assert "partial" in result.stdout
        assert "pcalib.txt" in names(tmp_path / "out")

    def test_json_reports_a_failure(self, recording, tmp_path, method):
        method.at_frame = {7: OSError("the disk is gone")}
        result = run(recording, "-o", tmp_path / "out", "--json")
        summary = json.loads(result.stdout)
        assert (summary["exit_code"], summary["partial"]) == (1, True)
        assert "the disk is gone" in summary["error"]

    def test_a_failed_run_keeps_a_complete_result_and_says_where_the_partial_one_is(
        self, recording, tmp_path, method
    ):
        out = tmp_path / "out"
        run(recording, "-o", out)
        before = contents(out)
        method.at_frame = {7: OSError("the disk is gone")}
        result = run(recording, "-o", out)
        assert contents(out) == before
        assert stored(out / "partial")["partial"] is True
        assert f"written to {out / 'partial'}: calibration.json" in result.stdout
        assert f"{out} keeps its complete result; the partial one is in {out / 'partial'}" in result.output.replace(
            "\n", " "
        )

    def test_a_failing_estimate_is_a_one_line_error_and_keeps_an_earlier_output(self, recording, tmp_path, method):
        run(recording, "-o", tmp_path / "out")
        before = stored(tmp_path / "out")
        method.at_the_end = np.linalg.LinAlgError("singular")
        result = run(recording, "-o", tmp_path / "out")
        assert str(result.exception) == "unexpected LinAlgError: singular"
        assert stored(tmp_path / "out") == before

    def test_a_full_disk_is_reported_and_keeps_complete_files(self, recording, tmp_path, method, monkeypatch):
        def fail(_vignette, path, _description):
            raise OspcError(f"{path}: cannot be written (No space left on device)")

        monkeypatch.setattr("ospc.formats.dso.write_vignette", fail)
        result = run(recording, "-o", tmp_path / "out")
        assert "No space left" in str(result.exception)
        assert names(tmp_path / "out") == ["calibration.json", "pcalib.txt", "times.txt"]


@pytest.mark.skipif(not IN_MAIN_THREAD, reason="signals reach only the main thread")
class TestInterruptions:
    @staticmethod
    def press(times, monkeypatch):
        """Press Ctrl-C this many times, as separate requests."""
        monkeypatch.setattr("ospc.cli.interruption._SAME_S", 0.0)
        for _ in range(times):
            os.kill(os.getpid(), signal.SIGINT)

    def test_repeated_keys_are_one_request(self, recording, tmp_path, method):
        def many():
            for _ in range(5):
                os.kill(os.getpid(), signal.SIGINT)

        method.at_the_end = many
        assert run(recording, "-o", tmp_path / "out").exit_code == 130
        assert stored(tmp_path / "out")["partial"] is True

    @pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
    def test_the_result_so_far_is_written_and_marked_partial(self, recording, tmp_path, method, number):
        method.at_frame = {5: lambda: os.kill(os.getpid(), number)}
        before = signal.getsignal(number)
        result = run(recording, "-o", tmp_path / "out")
        assert result.exit_code == 130
        content = stored(tmp_path / "out")
        assert content["partial"] is True
        assert content["counts"]["frames"] == 6
        assert "partial: the run was interrupted" in result.stdout
        assert "from 6 of 12 frames" in result.stdout
        assert "pcalib.txt" in names(tmp_path / "out")
        assert signal.getsignal(number) is before

    def test_while_estimating(self, recording, tmp_path, method):
        method.at_the_end = lambda: os.kill(os.getpid(), signal.SIGINT)
        result = run(recording, "-o", tmp_path / "out")
        assert result.exit_code == 130
        assert stored(tmp_path / "out")["partial"] is True

    def test_a_second_interruption_while_estimating_writes_nothing(self, recording, tmp_path, method, monkeypatch):
        method.at_the_end = lambda: self.press(2, monkeypatch)
        result = run(recording, "-o", tmp_path / "out")
        assert result.exit_code == 130
        assert "no result was written" in result.stderr
        assert not (tmp_path / "out").exists()

    def test_aborting_the_estimate_keeps_the_state(self, recording, tmp_path, monkeypatch):
        from ospc.calibrator import OnlineCalibrator
        from ospc.cli.calibration_run import Checkpoints

        def stop_at_the_fifth(_checkpoints, calibrator):
            if calibrator.frames == 5:
                os.kill(os.getpid(), signal.SIGINT)

        def give_up(_calibrator):
            raise KeyboardInterrupt

        monkeypatch.setattr(Checkpoints, "after_frame", stop_at_the_fifth)
        monkeypatch.setattr(OnlineCalibrator, "calibration", give_up)
        assert run(recording, "-o", tmp_path / "out").exit_code == 130
        assert names(tmp_path / "out") == ["state.ospc"]
        assert OnlineCalibrator.load_state(tmp_path / "out" / "state.ospc").frames == 5

    def test_before_the_first_frame(self, recording, tmp_path, monkeypatch):
        monkeypatch.setattr("ospc.cli.reading.open_recording", lambda *_: os.kill(os.getpid(), signal.SIGINT))
        result = run(recording, "-o", tmp_path / "out")
        assert result.exit_code == 130
        assert not (tmp_path / "out").exists()

    @pytest.mark.parametrize("times", [1, 3])
    def test_files_are_complete_if_interrupted_while_writing(self, recording, tmp_path, method, monkeypatch, times):
        def interrupted(response, path, values=256):
            self.press(times, monkeypatch)
            return write_pcalib(response, path, values)

        monkeypatch.setattr("ospc.formats.dso.write_pcalib", interrupted)
        result = run(recording, "-o", tmp_path / "out")
        assert result.exit_code == 130
        assert stored(tmp_path / "out")["partial"] is True
        assert names(tmp_path / "out") == ["calibration.json", "pcalib.txt", "times.txt", "vignette.png"]
        assert read_pcalib(tmp_path / "out" / "pcalib.txt")
        assert read_vignette(tmp_path / "out" / "vignette.png").size == SIZE


def test_ctrl_c_on_the_real_command(good_recording, tmp_path):
    """Run the real method in another process and send it real signals."""
    out = tmp_path / "out"
    code = (
        "import ospc.methods.maximum_likelihood as j, sys\n"
        "push = j.MaximumLikelihoodMethod.push\n"
        "def slow(self, frame, *more):\n"
        "    found = push(self, frame, *more)\n"
        "    if frame.index == 20:\n"
        "        print('now', flush=True)\n"
        "        import time; time.sleep(60)\n"
        "    return found\n"
        "j.MaximumLikelihoodMethod.push = slow\n"
        "from ospc.report.output_folder import OutputFolder, Written\n"
        "OutputFolder.report = lambda *_, **__: Written()\n"
        "from ospc.cli import interruption\n"
        "interruption._SAME_S = 0.1\n"
        "from ospc.cli.main import main\n"
        f"sys.argv = ['ospc', 'calibrate', {str(good_recording)!r}, '-o', {str(out)!r}]\n"
        "main()\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as p:
        assert p.stdout.readline() == "now\n"
        p.send_signal(signal.SIGINT)
        time.sleep(0.5)
        p.send_signal(signal.SIGINT)  # the first waits for the current frame, which takes a minute here
        output, errors = p.communicate(timeout=120)
    assert p.returncode == 130, errors
    assert "partial" in output
    content = Calibration.load(out)
    assert content.partial
    assert content.counts["frames"] == 21
    assert "figure.png" in names(out)
