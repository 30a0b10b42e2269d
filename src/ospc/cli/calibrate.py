"""``ospc calibrate``: response and vignette of a camera from one of its recordings."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ospc.cli.exposure_options import correct_lag_option
from ospc.cli.interruption import Interruption
from ospc.cli.live import Watching
from ospc.cli.reading import EACH, Reading, reading_options, say_topics
from ospc.errors import OspcError, SettingError

if TYPE_CHECKING:
    from ospc.exposures.findings import LagChoice
    from ospc.recording import Recording
    from ospc.settings import Settings

INTERRUPTED = 130


@dataclass(frozen=True)
class _Request:
    """What the user asked for, option by option."""

    path: Path
    out: Path
    preset_name: str
    overrides: dict[str, str]
    reading: Reading
    truth: str | None
    resume: bool
    checkpoint_s: float
    start_from: Path | None
    correct_lag: LagChoice
    pdf: bool
    live: bool
    rerun: bool
    rerun_file: Path | None
    force: bool
    quiet: bool
    as_json: bool
    all_cameras: bool

    @property
    def watching(self) -> Watching:
        """How the run is watched."""
        return Watching(live=self.live, viewer=self.rerun, stream=self.rerun_file)

    def of_camera(self, name: str) -> _Request:
        """Return what is asked for of one camera of a rig."""

        def own(place: str | Path) -> Path:
            inner = Path(place) / name
            return inner if inner.exists() else Path(place)

        truth = None if self.truth is None else str(own(self.truth))
        earlier = None if self.start_from is None else own(self.start_from)
        stream = None if self.rerun_file is None else self.rerun_file.with_stem(f"{self.rerun_file.stem}_{name}")
        return replace(self, out=self.out / name, truth=truth, start_from=earlier, rerun_file=stream)


def _parse_overrides(_ctx: click.Context, _param: click.Parameter, values: tuple[str, ...]) -> dict[str, str]:
    overrides = {}
    for value in values:
        name, found, text = value.partition("=")
        if not found:
            raise click.BadParameter(f"{value!r} is not NAME=VALUE, such as max_points=20000")
        overrides[name.strip()] = text.strip()
    return overrides


@click.command("calibrate")
@click.argument("path", type=click.Path(path_type=Path))
@click.option("-o", "--out", type=click.Path(path_type=Path), help="Folder to write the results to; required.")
@click.option(
    "--preset",
    "preset_name",
    type=click.Choice(["default", "fast", "paper"]),
    default="default",
    show_default=True,
    help="The method: maximum likelihood, the same with fewer frames and points, or the paper's.",
)
@click.option(
    "--set",
    "overrides",
    metavar="NAME=VALUE",
    multiple=True,
    callback=_parse_overrides,
    help="Change a setting of the preset; repeatable.",
)
@click.option(
    "--truth",
    metavar="PATH",
    help="A known calibration to compare with: calibration.json, or a folder with pcalib.txt and vignette.png.",
)
@click.option(
    "--resume", is_flag=True, help="Continue where an earlier run into OUT was stopped or killed, if there was one."
)
@click.option(
    "--checkpoint-every",
    "checkpoint_s",
    metavar="SECONDS",
    type=click.FloatRange(min=0),
    default=5.0,
    show_default=True,
    help="How often OUT/state.ospc is saved, from which --resume goes on; 0 for after every frame.",
)
@click.option("--live", is_flag=True, help="Show coverage and converging curves in the terminal while it runs.")
@click.option("--rerun", is_flag=True, help="Open the Rerun viewer and watch the run in it; needs the extra rerun.")
@click.option(
    "--rerun-file",
    metavar="FILE.rrd",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Stream the same to a file that the viewer opens later.",
)
@correct_lag_option
@click.option("--pdf", is_flag=True, help="Write the report as report.pdf too.")
@click.option(
    "--start-from",
    type=click.Path(path_type=Path),
    help="What was known of the camera before: a state.ospc, a calibration.json, or a folder with one. It counts as "
    "long as the recording agrees with it; a changed lens or focus is noticed.",
)
@click.option("--force", is_flag=True, help="Write into OUT even if it holds other files; those named as results go.")
@click.option("-q", "--quiet", is_flag=True, help="Say nothing but errors.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON summary on standard output.")
@reading_options
@click.option(
    "--all-cameras",
    is_flag=True,
    help="Calibrate every camera of a rig (a EuRoC folder, a bag, folders side by side), each into OUT/CAMERA; "
    "--truth and --start-from may be folders of the same names.",
)
@click.option(
    "--unknown-exposures",
    is_flag=True,
    help="Estimate the exposures from the images, whatever the recording says of them: everything is then known only "
    "up to one exponent, and labelled so.",
)
@click.option("--list-topics", is_flag=True, help="Say what topics the bag at PATH has, and do nothing else.")
def command(list_topics: bool, **options: Any) -> None:
    """Calibrate the camera of the recording at PATH.

    PATH is a folder or file of any kind that is known: a folder with images/ or images.zip and times.txt, a EuRoC
    folder, photographs with EXIF, folders named by exposure, images or a video with a list of exposures, a ROS bag.

    OUT gets report.html to look at, calibration.json, pcalib.txt, vignette.png, times.txt, and pictures. What the
    recording does not determine is not written, and why is said. OUT/state.ospc is what --resume goes on from and
    'ospc merge' takes.

    Ctrl-C ends the run early; what is known by then is written and marked partial.

    \b
    Exit codes:
      0    complete: response and vignette are known
      1    error; what was known by then is written as partial if possible
      2    wrong usage
      3    written, but response or vignette could not be determined, the exposures contradict the images, or the
           camera changed during the recording
      130  interrupted; the partial result is written
    """  # noqa: D301 (click reads the escaped character as "do not rewrap")
    if list_topics:
        say_topics(options["path"])
        return
    if options["out"] is None:
        raise click.UsageError("Missing option '-o' / '--out'.")
    if options["unknown_exposures"] and (options["resume"] or options["start_from"] or options["mask"]):
        raise click.UsageError("--unknown-exposures goes with none of --resume, --start-from and --mask")
    request = _Request(reading=Reading.taken_from(options), **options)
    with Interruption() as interruption:
        sys.exit(one_line(lambda: _calibrate(request, interruption)))


def one_line(work: Callable[[], int]) -> int:
    """Do the work and return its exit code; let whatever goes wrong end as one line instead of a traceback."""
    try:
        return work()
    except KeyboardInterrupt as interruption:
        why = f" ({interruption})" if interruption.args else ""
        click.echo(f"ospc: interrupted; no result was written{why}", err=True)
        return INTERRUPTED
    except (OspcError, click.ClickException):
        raise
    except Exception as error:
        from ospc.cli.calibration_run import sentence

        raise OspcError(sentence(error)) from error


def _calibrate(request: _Request, interruption: Interruption) -> int:
    from ospc.cli.calibration_run import print_json

    if request.all_cameras or request.reading.channel == EACH:
        return _calibrate_rig(request, interruption)
    return _calibrate_one(request, partial(request.reading.open, request.path), interruption, print_json)


def _calibrate_one(
    request: _Request,
    opened: Callable[[], Recording],
    interruption: Interruption,
    tell: Callable[[dict[str, Any]], None],
) -> int:
    from ospc.cli.calibration_run import Options, calibrate_into
    from ospc.cli.checkpoints import Checkpoints
    from ospc.exposures.findings import check_lag
    from ospc.formats.opening import open_photometry
    from ospc.output import OutputFolder
    from ospc.pooling.prior_calibration import PriorCalibration

    settings = _settings(request)
    prior = None if request.start_from is None else PriorCalibration.open(request.start_from)
    truth = None if request.truth is None else open_photometry(request.truth)
    recording = opened()
    if request.reading.unknown_exposures:
        recording = _with_recovered_exposures(recording, request, interruption)
    check_lag(request.correct_lag, len(recording))
    if prior is not None:
        prior.check_size(recording.size)
    folder = OutputFolder.at(request.out, recording=request.path, force=request.force)
    # A state says nothing of an exponent: it must not be merged with those of known exposures.
    keeps_state = not request.reading.unknown_exposures
    checkpoints = Checkpoints(folder.path, request.checkpoint_s, request.resume, prior) if keeps_state else None
    options = Options(
        quiet=request.quiet,
        as_json=request.as_json,
        truth=truth,
        checkpoints=checkpoints,
        pdf=request.pdf,
        tell=tell,
        watching=request.watching,
        # Exposures that come from the images cannot disagree with them.
        correct_lag="trusted" if request.reading.unknown_exposures else request.correct_lag,
    )
    return calibrate_into(folder, recording, settings, interruption, options)


def _with_recovered_exposures(recording: Recording, request: _Request, interruption: Interruption) -> Recording:
    from ospc.cli.progress import progress_bar
    from ospc.unknown_exposures import recover_exposures

    visible = not request.quiet and sys.stderr.isatty()
    with progress_bar("exposures", len(recording), visible=visible) as show, interruption.deferred():

        def step(done: int, total: int) -> None:
            if interruption.requested:
                raise KeyboardInterrupt
            show(done, total)

        return recover_exposures(recording, step)


def _calibrate_rig(request: _Request, interruption: Interruption) -> int:
    """Calibrate one camera after the other; what goes wrong with one does not keep the others from it."""
    from ospc.cli.calibration_run import print_json
    from ospc.cli.rig_scale import rig_scale_or_error

    told: dict[str, Any] = {}
    codes = []
    cameras = request.reading.cameras(request.path)
    for name, opened in cameras.items():
        if not request.quiet and not request.as_json:
            click.echo(f"{name}:")
        try:
            codes.append(
                _calibrate_one(request.of_camera(name), opened, interruption, partial(told.__setitem__, name))
            )
        except OspcError as error:
            click.echo(f"ospc: error: {name}: {error}", err=True)
            told.setdefault(name, {"exit_code": 1, "error": str(error)})
            codes.append(1)
        if interruption.requested:
            break
    code = next((c for c in (INTERRUPTED, 1, 3) if c in codes), 0)
    scale = None
    if len(cameras) > 1 and not interruption.requested:
        scale = rig_scale_or_error(request.out, cameras, talkative=not (request.quiet or request.as_json))
    if request.as_json:
        print_json({"exit_code": code, "cameras": told, "relative_scale": scale})
    return code


def _settings(request: _Request) -> Settings:
    from ospc.settings import preset, with_overrides

    try:
        return with_overrides(preset(request.preset_name), request.overrides)
    except SettingError as error:
        raise click.UsageError(str(error)) from None
