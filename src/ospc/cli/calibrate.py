"""``ospc calibrate``: response and vignette of a camera from a recording."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ospc.cli.interruption import Interruption, leaving
from ospc.cli.options import (
    AS_JSON,
    CORRECT_LAG,
    FORCE,
    LIST_TOPICS,
    QUIET,
    TRUTH,
    argument,
    declared,
    option,
    out_option,
    parse_assignments,
)
from ospc.cli.reading import READING_OR_ESTIMATING, Reading, print_topics
from ospc.cli.rig_scale import RIG_NAME, add_rig_scale
from ospc.cli.terminal import (
    COMPLETE,
    EXITS,
    FAILED,
    INTERRUPTED,
    UNDETERMINED,
    concluded,
    print_json,
    progress_of,
    say,
)
from ospc.errors import OspcError, RecordingError, SettingError
from ospc.recording import Recording
from ospc.recording.image_source import is_image_name
from ospc.settings import Settings, check_names, preset, with_overrides

if TYPE_CHECKING:
    from ospc.arrays import ImageSize
    from ospc.cli.calibration_result import ResultFolder
    from ospc.exposures.lag_choice import LagChoice


@dataclass(frozen=True)
class _Request:
    """Calibrate the camera of the recording at PATH.

    PATH is a folder with images/ or images.zip and times.txt, a EuRoC folder, photographs with EXIF, folders named by
    exposure, images or a video with a list of exposures, or a ROS bag.

    OUT gets report.html, calibration.json, pcalib.txt, vignette.png, times.txt, and figure.png. Parts that the
    recording does not determine are not written, and the output explains why. OUT/state.ospc is the input of --resume
    and 'ospc merge'.

    Ctrl-C ends the run early; the result so far is written and marked partial. If OUT has a complete result, that is
    kept, and the partial one is in OUT/partial.
    """

    interruption: Interruption
    path: Path = argument()
    out: Path = out_option("Folder to write the results to; required.", required=False)
    preset_name: str = option(
        "Method: maximum likelihood (default), the same with fewer frames and points (fast), or the paper's.",
        "--preset",
        type=click.Choice(["default", "fast", "paper"]),
        default="default",
    )
    overrides: tuple[str, ...] = option("Change a setting of the preset; repeatable.", "--set", metavar="NAME=VALUE")
    truth: str | None = TRUTH
    resume: bool = option("Continue an earlier run into OUT that was stopped or killed, if there is one.")
    checkpoint_s: float | None = option(
        "Interval for saving OUT/state.ospc, from which --resume continues; 0 to save after every frame. By default "
        "5 seconds, or longer if saving would take more than 2 % of the time.",
        "--checkpoint-every",
        metavar="SECONDS",
        type=click.FloatRange(min=0),
    )
    rerun: bool = option("Show the run in the Rerun viewer; needs the extra rerun.")
    rerun_file: Path | None = option(
        "Write the same stream to a file that the viewer can open later.",
        metavar="FILE.rrd",
        type=click.Path(path_type=Path, dir_okay=False),
    )
    correct_lag: LagChoice = CORRECT_LAG
    start_from: Path | None = option(
        "Earlier calibration of the camera: a state.ospc, a calibration.json, or a folder with one. It is used as "
        "long as the recording agrees with it; a changed lens or focus is detected."
    )
    force: bool = FORCE
    quiet: bool = QUIET
    as_json: bool = AS_JSON
    reading: Reading = READING_OR_ESTIMATING
    all_cameras: bool = option(
        "Calibrate every camera of a rig (a EuRoC folder, a bag, neighbouring folders), each into OUT/CAMERA; "
        "--truth and --start-from may contain subfolders named after the cameras."
    )
    fallback: str | None = option(
        "Method for a single photograph or a recording without exposures: single-image takes a typical response, "
        "guesses the vignette from shading, with wide bands for both, and labels every file as a guess.",
        type=click.Choice(["single-image"]),
    )
    list_topics: bool = LIST_TOPICS

    def run(self) -> int | None:
        if self.list_topics:
            print_topics(self.path)
            return None
        if self.out is None:
            raise click.UsageError("Missing option '-o' / '--out'.")
        self._refuse_ignored_options()
        if self.all_cameras or self.reading.each_channel:
            return _calibrate_rig(self)
        with leaving("no result was written"):
            content = _calibrate_one(self, partial(self.reading.open, self.path))
        return concluded(content, as_json=self.as_json)

    def _refuse_ignored_options(self) -> None:
        """Refuse options that would have no effect together with another one."""
        resuming = {"--resume": self.resume, "--start-from": self.start_from is not None}
        guessing = {
            "--unknown-exposures": self.exposures_unknown,
            "--mask": self.reading.mask,
            "--roi": self.reading.region,
            "--channel each": self.reading.each_channel,
            "--all-cameras": self.all_cameras,
        }
        estimating = {
            "--checkpoint-every": self.checkpoint_s is not None,
            "--correct-lag": self.correct_lag != "auto",
        }
        for chosen, is_chosen, others in (
            ("--fallback", self.fallback, guessing | resuming),
            ("--unknown-exposures", self.exposures_unknown, resuming | estimating),
        ):
            ignored = [name for name, given in others.items() if given]
            if is_chosen and ignored:
                raise click.UsageError(f"{chosen} cannot be combined with {' or '.join(ignored)}")

    @property
    def prints_text(self) -> bool:
        return not (self.quiet or self.as_json)

    @property
    def exposures_unknown(self) -> bool:
        return self.reading.options.unknown_exposures

    @property
    def settings(self) -> Settings:
        try:
            settings = with_overrides(preset(self.preset_name), parse_assignments(self.overrides, "max_points=20000"))
            if self.overrides:
                check_names(settings)
        except SettingError as error:
            raise click.UsageError(str(error)) from None
        return settings

    def result(self, size: ImageSize) -> ResultFolder:
        """Return the folder of the result, with the truth; refuse one that must not be written to."""
        from ospc.cli.calibration_result import ResultFolder
        from ospc.formats.opening import open_photometry
        from ospc.report.output_folder import OutputFolder

        truth = None if self.truth is None else open_photometry(self.truth, size)
        folder = OutputFolder.at(self.out, recording=self.path, force=self.force)
        return ResultFolder(folder, self.interruption, self.quiet, self.as_json, truth)

    def of_camera(self, name: str) -> _Request:
        """Return the request for one camera of a rig."""

        def own(place: str | Path) -> Path:
            inner = Path(place) / name
            return inner if inner.exists() else Path(place)

        truth = None if self.truth is None else str(own(self.truth))
        earlier = None if self.start_from is None else own(self.start_from)
        stream = None if self.rerun_file is None else self.rerun_file.with_stem(f"{self.rerun_file.stem}_{name}")
        return replace(self, out=self.out / name, truth=truth, start_from=earlier, rerun_file=stream)


command = declared("calibrate", exits=EXITS)(_Request)


def _calibrate_one(request: _Request, opened: Callable[[], Recording]) -> dict[str, Any]:
    settings, prior = request.settings, None
    if request.start_from is not None:
        from ospc.pooling.prior_calibration import PriorCalibration

        prior = PriorCalibration.open(request.start_from)
        prior.check_method(settings)
    try:
        recording = opened()
    except RecordingError as error:
        if request.fallback is not None:
            return _guess(request)
        if request.path.is_file() and is_image_name(request.path.name):
            raise RecordingError(f"{error}, or guess from it alone with --fallback single-image") from None
        raise
    from ospc.report.drawing import drawing_process

    drawing_process()  # loads its modules while this one does
    # Imported late, because it is slow: problems with the recording are reported first.
    from ospc.cli.calibration_run import CalibrationRun, Checkpoints
    from ospc.system.folders import check_new

    if request.rerun_file is not None:
        check_new([request.rerun_file], force=request.force or request.resume)
    result = request.result(recording.size)
    if request.exposures_unknown:
        from ospc.unknown_exposures import recover_exposures

        with progress_of("exposures", quiet=request.quiet, interruption=request.interruption) as step:
            recording = recover_exposures(recording, step)
    if prior is not None:
        prior.check_size(recording.size)
    return CalibrationRun(
        recording,
        settings,
        result,
        Checkpoints(
            result.folder,
            request.checkpoint_s,
            resume=request.resume,
            prior=prior,
            # A state does not contain an exponent, so it must not be merged with states of known exposures.
            wanted=not request.exposures_unknown,
        ),
        request.correct_lag,
        request.rerun,
        request.rerun_file,
    ).calibrate()


def _guess(request: _Request) -> dict[str, Any]:
    """Guess a calibration from single images; it is never complete."""
    from ospc.cli.calibration_result import CalibrationOutcome
    from ospc.correction.source import open_source
    from ospc.unknown_exposures.single_image.fallback import calibrate_single_images

    recording = open_source([request.path], request.reading.kind, request.reading.options).recording
    result = request.result(recording.size)
    calibration = replace(calibrate_single_images(recording), source={"name": request.path.name})
    content = result.take(CalibrationOutcome(calibration), None, [calibration.caveat])
    return content | {"rests_on": calibration.rests_on}


def _calibrate_rig(request: _Request) -> int:
    """Calibrate one camera after the other; the failure of one does not stop the others."""
    contents: dict[str, dict[str, Any]] = {}
    written: dict[str, Callable[[], Recording]] = {}
    cameras = request.reading.cameras(request.path)
    for name, opened in cameras.items():
        if request.prints_text:
            say(f"{name}:")
        try:
            with leaving(f"no result was written for {name}"):
                contents[name] = _calibrate_one(request.of_camera(name), opened)
        except OspcError as error:
            contents[name] = {"exit_code": FAILED, "error": str(error)}
        if contents[name].get("out") == str(request.out / name):  # otherwise, an earlier result may still be there
            written[name] = opened
            with suppress(OSError):  # that of an earlier run belongs to other calibrations
                (request.out / RIG_NAME).unlink()
        if contents[name]["error"]:
            say(f"ospc: error: {name}: {contents[name]['error']}", err=True)
        if request.interruption.requested:
            break
    codes = {content["exit_code"] for content in contents.values()}
    code = next((c for c in (INTERRUPTED, FAILED, UNDETERMINED) if c in codes), COMPLETE)
    scale = None
    # Channels of one camera see different light.
    if len(cameras) > 1 and not request.reading.each_channel and not request.interruption.requested:
        try:
            with leaving("the calibrations were written, but no relative irradiance scale"):
                scale = add_rig_scale(request.out, written, prints_text=request.prints_text)
        except OspcError as error:  # the calibrations are valid without the scale
            say(f"ospc: error: no relative irradiance scale: {error}", err=True)
            scale = {"error": str(error)}
    if request.as_json:
        print_json({"exit_code": code, "cameras": contents, "relative_scale": scale})
    return code
