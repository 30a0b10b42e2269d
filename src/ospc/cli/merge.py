"""``ospc merge``: one calibration from several recordings of a camera."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ospc.cli.interruption import Interruption
from ospc.cli.options import AS_JSON, FORCE, QUIET, TRUTH, argument, declared, out_option
from ospc.cli.terminal import COMPLETE, UNDETERMINED, concluded, say_notes
from ospc.errors import FormatError, SettingError, counted, listed

if TYPE_CHECKING:
    from ospc.pooling.summary import Summary
    from ospc.report.output_folder import OutputFolder

_NO_FIT = "no response could be fitted to this recording alone, as with a constant exposure; calibrate it to see why"


@declared(
    "merge",
    exits={
        COMPLETE: "complete: response and vignette are identifiable",
        UNDETERMINED: "written, but response or vignette is marginal or not identifiable",
    },
)
def command(
    interruption: Interruption,
    *,
    states: tuple[Path, ...] = argument(required=True),
    out: Path = out_option("Folder to write the results to."),
    truth: str | None = TRUTH,
    force: bool = FORCE,
    quiet: bool = QUIET,
    as_json: bool = AS_JSON,
) -> int:
    """Merge the STATES of recordings of one camera into one calibration.

    STATES are state.ospc files written by 'ospc calibrate' or 'ospc merge', or their folders, in any order. A
    recording given twice counts once. From an unfinished run, the frames so far are used. Recordings that contradict
    the others are reported and left out.

    OUT gets the files that 'ospc calibrate' writes; OUT/state.ospc can be merged again with others.
    """
    from ospc.cli.calibration_result import CalibrationOutcome, ResultFolder
    from ospc.formats.opening import open_photometry
    from ospc.pooling.pool import Pool, merge
    from ospc.report.output_folder import OutputFolder

    folder = OutputFolder.at(out, force=force)
    _check_kept(states, folder)
    given = [(place, _summaries(place)) for place in states]
    empty = [str(place) for place, summaries in given if not summaries]
    if len(empty) == len(given):
        raise FormatError(f"{listed(empty)}: {_NO_FIT}")
    found = _distinctly_named([(place, summary) for place, summaries in given for summary in summaries])
    pool = Pool.of(found)
    merged = merge(pool)
    differing = list(merged.agreement.differing.values())
    repeated = len(found) - len(pool.summaries)
    notes = [f"{repeated} of {counted(len(found), 'state')} left out, because each recording counts once"]
    known = None if truth is None else open_photometry(truth, merged.calibration.size)
    result = ResultFolder(folder, interruption, quiet, as_json, known)
    content = result.take(CalibrationOutcome(merged.calibration), pool.save, notes if repeated else ())
    if not as_json:
        say_notes((f"{place} was left out: {_NO_FIT}" for place in empty), "warning")
        say_notes((f"{d.name} differs from the others: {d.text}" for d in differing), "warning")
    content |= {"differing": [vars(difference) for difference in differing], "left_out": empty}
    return concluded(content, as_json=as_json)


def _summaries(place: Path) -> Sequence[Summary]:
    """Return the summaries of recordings in a state that could be fitted, also of a run that did not end."""
    from ospc.calibrator import OnlineCalibrator
    from ospc.pooling.pool import Pool
    from ospc.pooling.summary import Summary
    from ospc.state.container import kind_of, state_in
    from ospc.state.run import KIND, load_summary

    file = state_in(place)
    if kind_of(file) != KIND:
        return Pool.load(file).summaries
    summary = load_summary(file, Summary) or OnlineCalibrator.load_state(file).summary()
    return [] if summary is None else [summary]


def _check_kept(states: Sequence[Path], folder: OutputFolder) -> None:
    """Refuse to replace the states to merge, and the calibrations beside them."""
    from ospc.state.container import state_in

    replaced = {place.path.resolve() for place in (folder, folder.for_partial_results)}
    for place in states:
        if state_in(place).resolve().parent in replaced:
            raise SettingError(
                f"{folder.path}: contains a state to merge, {place}; choose another folder for the output"
            )


def _distinctly_named(found: Sequence[tuple[Path, Summary]]) -> list[Summary]:
    """Add the path of the state to the names of recordings that share a name."""
    recordings = Counter(name for name, _key in {(summary.name, summary.key) for _, summary in found})
    return [
        replace(summary, name=f"{summary.name} ({place})") if recordings[summary.name] > 1 else summary
        for place, summary in found
    ]
