"""The fault study: its runs, tables and files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, fields
from typing import Any, get_args

from ospc.formats.files import csv_text
from ospc.research.faults.footage import STRENGTHS, Fault, GoodSource
from ospc.research.faults.judging import CLEAN, KINDS, FaultOutcome, Run, fault_task
from ospc.research.runner import Task
from ospc.research.tables import StudyReport, Table, benchmark_report

SCHEMA = "ospc-benchmark-faults/1"

OUTCOMES: tuple[FaultOutcome, ...] = get_args(FaultOutcome)

_NOTE = (
    "Detected: an error, a warning, or a quantity called not identifiable. Corrected and harmless: errors within 3σ, "
    "κ ≤ 0.005 and vignette ≤ 0.005, with and without a note. Uncertain: an error is larger, but within 3σ, and its "
    "curve is called marginal. Indistinguishable: right for another camera that takes the same images at the stated "
    "exposures. Confident and wrong: the rest. Step is the error of ln g(0.75)/g(0.25)."
)


def fault_tasks(
    sources: Sequence[GoodSource], faults: Sequence[Fault], strengths: Sequence[str] = STRENGTHS
) -> list[Task]:
    """Return the runs for every recording: first without a fault, then with each fault at each strength."""
    tasks = []
    for source in sources:
        tasks.append(fault_task(source))
        tasks += [fault_task(source, fault, STRENGTHS.index(name)) for fault in faults for name in strengths]
    return tasks


def fault_tables(runs: Sequence[Run]) -> list[Table]:
    """Return the outcomes in total and by fault and strength, and all runs that are confident and wrong."""
    clean = [run for run in runs if run.fault == CLEAN]
    faulty = [run for run in runs if run.fault != CLEAN]
    totals = (("without a fault", clean), ("with a fault", faulty))
    tables = [Table("Outcomes", ("recordings", "runs", *OUTCOMES), tuple((k, *_counts(v)) for k, v in totals if v))]
    for kind, faults in KINDS.items():
        lines = [
            (fault.in_words(fault.strengths[number]), fault.name, strength, *_counts(members), *_worst(members))
            for fault in faults
            for number, strength in enumerate(STRENGTHS)
            if (members := [run for run in faulty if (run.fault, run.strength) == (fault.name, strength)])
        ]
        header = ("what happens", "fault", "strength", "runs", *OUTCOMES, "largest κ", "step", "V")
        tables.append(Table(f"Faults of {kind}", header, tuple(lines), names=3))
    wrong = []
    for run in runs:
        if run.outcome in ("confident and wrong", "crashed"):
            doubts = (f"{name} {state}" for name, state in run.states.items() if state != "identifiable")
            names = (run.fault, run.strength, run.recording, ", ".join(doubts))
            wrong.append((*names, *_figures(run), _text(run.vignette_sigmas, 1), ", ".join(run.beyond)))
    header = ("fault", "strength", "recording", "verdicts", "κ", "step", "V", "V error in σ", "beyond")
    tables.append(Table("Confident and wrong, and crashed: every run", header, tuple(wrong), names=4))
    alarms = tuple((run.recording, run.outcome, "; ".join(run.said)) for run in clean if run.false_alarm)
    tables.append(Table("False alarms on clean recordings", ("recording", "outcome", "messages"), alarms, names=3))
    return [table for table in tables if table.rows]


def faults_report(runs: Sequence[Run], notes: Sequence[str]) -> StudyReport:
    """Return the report, with ``results.json``, ``results.csv`` and ``table.md``."""
    lines = [[_cell(value) for value in vars(run).values()] for run in runs]
    csv = csv_text([[field.name for field in fields(Run)], *lines])
    content = [asdict(run) for run in runs]
    return benchmark_report("faults", _NOTE, notes, fault_tables(runs), csv, schema=SCHEMA, runs=content)


def _counts(runs: Sequence[Run]) -> tuple[str, ...]:
    counts = (sum(run.outcome == outcome for run in runs) for outcome in OUTCOMES)
    return (str(len(runs)), *(str(count) if count else "" for count in counts))


def _worst(runs: Sequence[Run]) -> tuple[str, ...]:
    """Return the figures of the undetected run with the largest error, if any."""
    silent = [run for run in runs if run.outcome != "detected" and run.kappa is not None]
    return _figures(max(silent, key=lambda run: run.kappa or 0.0)) if silent else ("–", "–", "–")


def _figures(run: Run) -> tuple[str, str, str]:
    step = "–" if run.step is None else f"{run.step:+.4f} ± {_text(run.step_sigma, 4)}"
    return _text(run.kappa, 4), step, _text(run.vignette, 4)


def _text(value: float | None, digits: int) -> str:
    return "–" if value is None else f"{value:.{digits}f}"


def _cell(value: Any) -> Any:
    if isinstance(value, dict):
        return "; ".join(f"{name} {state}" for name, state in value.items())
    return " | ".join(value) if isinstance(value, tuple | list) else value
