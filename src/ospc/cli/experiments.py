"""``ospc experiments``: the paper's figures and tables, and related experiments."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ospc.cli.options import STUDY_SIZE, argument, declared, option, parse_assignments
from ospc.cli.studies import CALIBRATIONS, DATA, JOBS, by_name, given_calibrations, run_study, study_out_option

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ospc.research.method import Outcome
    from ospc.research.runner import Finished
    from ospc.research.source import Source
    from ospc.research.tables import StudyReport

_EXPERIMENTS = {
    "parameters": "Response, vignette and exposure ratios against the truth (figure 3).",
    "joint": "Ours, joint estimation with and without one point of the true response, and other methods (figure 4).",
    "solvers": "Solvers of the vignette: L2, L1, M-estimator, ours (section 5).",
    "features": "Features for the response: SIFT, SURF, ORB, ours (section 5); SURF needs the extra 'surf'.",
    "offsets": "Offset between the two frames of a pair for the vignette, 10 to 50 (section 5).",
    "thresholds": "Minimum exposure ratio of a pair for the response (section 5).",
    "static": "Methods for a static camera, on exposure sweeps.",
    "ambiguity": "The exponential ambiguity: without known exposures, every exponent explains a recording.",
}
_AMBIGUITY_FRAMES = 300


@click.group("experiments")
def command() -> None:
    """Reproduce the paper's figures and tables, on given recordings or on simulated stand-ins.

    RECORDINGS are folders in the layout of the TUM monocular data set; their pcalib.txt and vignette.png are the
    truth. Without RECORDINGS, recordings are simulated: with the data set's narrow camera and real exposures if
    --data (or OSPC_DATA) names a folder that contains them, with an analytic camera otherwise. Finished recordings
    are kept in OUT/cache: the same command continues an interrupted run, and recomputes only what has changed.
    """


@dataclass(frozen=True)
class _Run:
    """One of the experiments; all take the same options."""

    name: str
    recordings: tuple[Path, ...] = argument()
    out: Path = study_out_option("ospc-experiments")
    data: Path | None = DATA
    count: int | None = option("Number of simulated recordings.", type=click.IntRange(1, 1000))
    frames: int | None = option("Frames used per recording.", type=click.IntRange(2, 1_000_000))
    size: tuple[int, int] = option("Size of simulated images.", type=STUDY_SIZE, metavar="WxH", default="320x240")
    speed: float | None = option("Speed factor of the simulated motion.")
    given: tuple[str, ...] = CALIBRATIONS
    estimated: tuple[str, ...] = option(
        "Exposures from another program to compare: the last number of each line, one line per frame.",
        "--exposures",
        metavar="NAME=FILE",
    )
    jobs: int = JOBS

    def run(self) -> None:
        if self.name == "ambiguity":
            self._show_ambiguity()
            return
        from ospc.research.experiments.design import EXPERIMENTS, experiment_report
        from ospc.research.source import judge, loaded, measuring_task

        experiment = EXPERIMENTS[self.name]
        sources = self._sources(*experiment.stand_ins, speed=experiment.speed, stationary=experiment.stationary)
        others = self._others()

        def report(finished: Sequence[Finished]) -> StudyReport:
            done = [task.about for task, _ in finished]
            rows = [row for task, result in finished for row in (*loaded(result), *judge(task.about, others))]
            return experiment_report(experiment, done, rows)

        tasks = [measuring_task(source, experiment) for source in sources]
        run_study(tasks, self.out, self.jobs, report)

    def _show_ambiguity(self) -> None:
        from ospc.research.experiments.ambiguity import ambiguity_report, ambiguity_task

        if self.given or self.estimated or max(len(self.recordings), self.count or 1) > 1:
            raise click.UsageError("ambiguity needs a single recording, and compares no --calibration or --exposures")
        (source,) = self._sources(1, _AMBIGUITY_FRAMES)
        run_study(
            [ambiguity_task(source)], self.out, 1, lambda finished: ambiguity_report(finished[0][1], source.name)
        )

    def _sources(self, count: int, frames: int, *, speed: float = 1.0, stationary: bool = False) -> list[Source]:
        """Return the given recordings, or simulated ones; ``count`` and ``frames`` are defaults."""
        from ospc.research.experiments.sources import stand_ins, sweeps
        from ospc.research.source import GivenSource

        if self.recordings:
            _refuse("given recordings", "count", "size", "speed", "data")
            return [GivenSource.of(place, self.frames) for place in by_name(self.recordings).values()]
        count, frames = self.count or count, self.frames or frames
        if stationary:
            _refuse("a static camera", "speed", "data")
            return [*sweeps(count, frames, self.size)]
        return [*stand_ins(count, frames, self.size, self.data, speed=self.speed or speed)]

    def _others(self) -> dict[str, Outcome]:
        """Return the results of other programs; exposures belong to the calibration of the same name, if any."""
        from ospc.recording.table_text import exposures_in
        from ospc.research.method import Estimate

        calibrations = given_calibrations(self.given)
        files = parse_assignments(self.estimated, "theirs=times.txt")
        exposures = {name: dict(enumerate(exposures_in(file))) for name, file in files.items()}
        found: dict[str, Outcome] = {}
        for name in dict.fromkeys([*calibrations, *exposures]):
            curves = calibrations.get(name)
            response, vignette = (None, None) if curves is None else (curves.response, curves.vignette)
            found[name] = Estimate(response, vignette, exposures=exposures.get(name))
        return found


def _refuse(with_what: str, *names: str) -> None:
    """Refuse options of the command line that would have no effect; one from the environment may remain."""
    source_of = click.get_current_context().get_parameter_source
    if ignored := [f"--{name}" for name in names if source_of(name) is click.core.ParameterSource.COMMANDLINE]:
        raise click.UsageError(f"{' and '.join(ignored)} cannot be combined with {with_what}")


for _name, _help in _EXPERIMENTS.items():
    declared(_name, command, help=_help)(partial(_Run, _name))
