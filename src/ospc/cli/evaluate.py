"""``ospc evaluate``: trajectories, and the effect of a calibration on tracking and odometry."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ospc.cli.correct import warn_of_assumed
from ospc.cli.interruption import leaving
from ospc.cli.options import AS_JSON, ASSUME_MISSING, argument, declared, option
from ospc.cli.reading import KIND
from ospc.cli.studies import (
    CALIBRATIONS,
    JOBS,
    by_name,
    given_calibrations,
    run_study,
    study_cache,
    study_out_option,
    words,
)
from ospc.cli.terminal import print_json, progress_line, progress_of, say
from ospc.errors import SettingError, counted

if TYPE_CHECKING:
    from ospc.evaluation.tracking import TrackingComparison
    from ospc.research.odometry.experiment import Odometry

command = click.Group("evaluate", help="Evaluate trajectories, and the effect of a calibration on tracking.")


@declared("ealign", command)
def ealign(
    *,
    trajectory: Path = argument(),
    truth: Path = argument(),
    interval: float = option("Interval for the relative pose error (RPE), in seconds.", default=1.0),
    as_json: bool = AS_JSON,
) -> None:
    """Compute the drift of TRAJECTORY from its alignments to the two halves of TRUTH.

    Both files have rows 'stamp tx ty tz qx qy qz qw', like DSO's result.txt and groundtruthSync.txt of the TUM
    monocular data set. Rows of the truth with NaN are unknown. Prints e_align (root mean square distance between the
    trajectory aligned to the first half and to the second half, in units of the truth), e_s (ratio of the two
    scales) and e_r (angle between the two rotations, in degrees). After one alignment to all poses with truth, also
    prints the root mean square absolute error (ATE) and that of the motions over an interval (RPE).
    """
    from ospc.errors import FormatError, NotObservableError
    from ospc.evaluation.trajectory import alignment_error, read_trajectory, relative_pose_error

    estimate, known = read_trajectory(trajectory), read_trajectory(truth)
    error = alignment_error(estimate, known)
    figures: dict[str, Any] = {
        **vars(error),
        "e_r": error.e_r_deg,
        "ate": error.rmse,
        "rpe_translation": None,
        "rpe_rotation_deg": None,
        "rpe_interval_s": interval,
    }
    try:
        relative = relative_pose_error(estimate, known, interval)
        figures |= {"rpe_translation": relative.translation, "rpe_rotation_deg": relative.rotation_deg}
    except (FormatError, NotObservableError) as problem:
        figures["rpe_missing"] = str(problem)
    if as_json:
        print_json(figures)
        return
    lines = [
        "e_align  {e_align:.4f}   in units of the truth",
        "e_s      {e_s:.4f}   scale of the first alignment over that of the second",
        "e_r      {e_r_deg:.3f}°   in degrees",
        "ATE      {ate:.4f}   after one alignment to all of the truth, in its units",
        "RPE      {rpe_missing}"
        if figures["rpe_translation"] is None
        else "RPE      {rpe_translation:.4f} and {rpe_rotation_deg:.3f}°   in motions over {rpe_interval_s:g} s",
        "poses    {poses}, {first} with truth in its first half and {second} in its second",
    ]
    if error.unmatched:
        lines.append("         {unmatched} have no row of the truth within 1 ms")
    for line in lines:
        say(line.format(**figures))


@declared("tracking", command)
def tracking(
    *,
    recording: Path = argument(),
    calibration: str = option("calibration.json, 'pcalib.txt,vignette.png', or a folder with them.", required=True),
    assume_missing: bool = ASSUME_MISSING,
    kind: str | None = KIND,
    as_json: bool = AS_JSON,
) -> None:
    """Measure how much a calibration helps to track points in RECORDING.

    Corners of the raw frames are tracked by the Lucas-Kanade method, with the same settings through the raw frames
    and through corrected frames. Corrected frames are those that the camera would have recorded without vignette, any
    two successive ones at the same exposure. A track is lost if tracking fails, if backward tracking ends more than a
    pixel away (forward-backward error), if the two windows differ by more than half of their contrast (appearance),
    or if the mean grey level has changed by more than that since the track began (brightness), which direct methods
    do not tolerate. A track that leaves the image ends, but is not lost.

    The brightness residual is the change of a track's mean grey level since its start, relative to the contrast
    within its window. A direct method has to explain it.

    Unknown exposures are treated as equal: only the vignette is corrected.
    """
    from ospc.correction.recording import corrector_for
    from ospc.correction.source import open_source
    from ospc.evaluation.tracking import compare_tracking
    from ospc.exposures.used import check_exposures_fit, with_used_exposures
    from ospc.formats.opening import open_photometry
    from ospc.recording.derived import with_sensor_depth

    source = open_source([recording], kind)
    photometry = open_photometry(calibration, source.recording.size)
    frames = with_sensor_depth(source.recording, photometry.max_grey)
    check_exposures_fit(frames, photometry.calibration)
    frames = with_used_exposures(frames, photometry.calibration)
    corrector = corrector_for(frames, photometry, assume_missing=assume_missing)
    with progress_of("tracking", quiet=as_json) as step:
        result = compare_tracking(frames, corrector, progress=step)
    if as_json:
        ratios = {"life_ratio": result.life_ratio, "residual_ratio": result.residual_ratio}
        head = {
            "sentence": result.sentence,
            "assumed_identity": list(corrector.assumed),
            "exposures_known": source.unexposed is None,
        }
        print_json(head | asdict(result) | ratios)
        return
    warn_of_assumed(corrector.assumed)
    _print_tracking(result, exposures_known=source.unexposed is None)


def _print_tracking(result: TrackingComparison, *, exposures_known: bool) -> None:
    from ospc.report.words import tracking_rows

    for label, before, after, unit in [("", "raw", "corrected", ""), *tracking_rows(result)]:
        say(f"{label:26} {before:>10} {after:>10}   {unit}".rstrip())
    exposures = (
        f"exposures change by up to {result.largest_step:.3g}:1 from frame to frame"
        if exposures_known
        else "exposures are unknown and assumed to be equal, so only the vignette is corrected"
    )
    say(
        f"{counted(result.tracks, 'track')} in {counted(result.frames, 'frame')}, each followed for up to "
        f"{counted(result.horizon, 'frame')}; {exposures}"
    )
    if result.skipped:
        say(f"{counted(result.skipped, 'frame')} could not be used", err=True)
    say(result.sentence)


@declared("odometry", command)
def odometry(
    *,
    recordings: tuple[Path, ...] = argument(required=True),
    program: Path | None = option("Your dso_dataset, or a program with the same arguments."),
    builtin: bool = option("Use the built-in direct odometry; needs simulated recordings."),
    out: Path = study_out_option("ospc-odometry"),
    runs: int = option("Runs per recording and condition.", type=click.IntRange(1, 1000), default=10),
    conditions: str = option(
        "Conditions to compare, separated by commas; 'affine' is also available: no calibration, mode 1.",
        default="truth,paper,ours,joint-wgt,joint-wogt,none",
    ),
    given: tuple[str, ...] = CALIBRATIONS,
    jobs: int = JOBS,
    timeout: float = option("Time limit of a run in seconds.", default=3600.0),
    arguments: tuple[str, ...] = option("Argument of the program, such as preset=0; repeatable.", "--argument"),
    as_json: bool = AS_JSON,
) -> None:
    """Run direct visual odometry on RECORDINGS with several calibrations, and compare the drift.

    Each recording is a folder in the layout of the TUM monocular data set, with camera.txt and groundtruthSync.txt;
    'truth' uses its pcalib.txt and vignette.png. 'paper', 'ours' and the joint estimates are computed from the
    recording itself. A calibration given under the name of a condition replaces its estimate.

    OUT gets table.md (medians of e_align, the lowest in bold), runs.csv, results.json, cumulative.png and the
    trajectories. Every finished run is kept in OUT: the same command continues an interrupted experiment.
    """
    from ospc.recording import open_recording
    from ospc.research.odometry.experiment import Experiment, result_of, tasks_of
    from ospc.research.odometry.inputs import Calibrations, chosen, external
    from ospc.research.odometry.report import odometry_report

    opened = {name: open_recording(place) for name, place in by_name(recordings).items()}
    files = given_calibrations(given)
    columns = chosen(words(conditions))
    columns += tuple(external(name) for name in files if name not in {c.name for c in columns})
    tracker = _odometry(program, arguments, timeout, recordings if builtin else ())
    cache = study_cache(out)
    with leaving("the same command continues where it stopped"), progress_line() as show:
        estimates = Calibrations(cache / "calibrations", files, lambda what, share: show(what, 100 * share, 100))
        experiment = Experiment(opened, columns, runs, estimates, cache)
        tasks, failed = tasks_of(experiment, tracker)
    run_study(
        tasks,
        out,
        jobs,
        lambda finished: odometry_report(experiment, [*failed, *(result_of(one, experiment) for one in finished)]),
        as_json=as_json,
    )


def _odometry(
    program: Path | None, arguments: tuple[str, ...], timeout: float, simulated: tuple[Path, ...]
) -> Odometry:
    """Return the program, or the built-in odometry if there are simulated recordings for it."""
    if bool(simulated) == (program is not None):
        raise SettingError("give either the path of your dso_dataset with --program, or --builtin")
    if simulated and arguments:
        raise SettingError("the built-in odometry takes no --argument; leave it out, or give --program")
    if program is not None:
        from ospc.research.odometry.program import Program

        return Program(program, timeout, *([tuple(arguments)] if arguments else []))
    from ospc.research.odometry.direct import DirectOdometry, SceneDepth

    for place in simulated:
        SceneDepth.of(place)  # fail early if the depth of a scene is unknown
    return DirectOdometry()
