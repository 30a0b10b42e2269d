"""Calibrate recordings without faults, and report false alarms, errors and the coverage of the confidence bands.

    python benchmarks/clean_recordings.py --results clean --recordings 200 --jobs 2

They are drawn at random, see random_recordings.py; measured responses are among them if the environment variable
OSPC_DATA names the folder of real data. Results are stored in a folder, and an interrupted run continues.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from ospc import calibrate
from ospc.research.faults.judging import log_step, step_sigma
from ospc.research.source import SimulatedSource
from ospc.simulation import truth
from random_recordings import measured_responses, recordings
from results import Row, figures_of, measured, table_of

_COVERAGE = tuple(f"{part}_within_{sigmas}_sigma" for part in ("response", "vignette") for sigmas in (1, 2))
_COLUMNS = ("recording", "frames", "response", "vignette", "exposures", "kappa", "V", "step", "step sigma", "said")


def row(source: SimulatedSource) -> Row:
    found, response = calibrate(source.frames()), truth(source.settings).response
    figures = figures_of(found, source.settings)
    return {
        "recording": source.name,
        "frames": source.count,
        **{part: verdict.state for part, verdict in found.verdicts.items()},
        "kappa": figures.get("log_ratio_error"),
        "V": figures.get("vignette_rmse"),
        **{share: figures.get(share) for share in _COVERAGE},
        "step": None if found.response is None else log_step(found.response) - log_step(response),
        "step sigma": step_sigma(found),
        "said": "; ".join(found.warnings),
    }


def summary(rows: Sequence[Row]) -> str:
    alarms = sum(bool(row["said"]) or row["exposures"] == "not identifiable" for row in rows)
    lines = [f"{len(rows)} recordings, {alarms} false alarms"]
    lines += [f"{name}: {np.mean([row[name] for row in rows if row[name] is not None]):.1%}" for name in _COVERAGE]
    for part, figure in (("response", "kappa"), ("vignette", "V")):
        sure = [row[figure] for row in rows if row[part] == "identifiable"]
        lines.append(f"{figure} of {len(sure)} identifiable: {np.median(sure):.4f} median, {max(sure):.4f} worst")
    deviate = np.abs([row["step"] / row["step sigma"] for row in rows if row["step sigma"]])
    shares = ", ".join(f"{np.mean(deviate < limit):.1%} within {limit}" for limit in (1, 2, 3))
    lines.append(f"ln g(0.75)/g(0.25) over its sigma: {shares}, {deviate.max():.2f} worst")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--results", type=Path, required=True, help="Folder of the results.")
    parser.add_argument("--recordings", type=int, default=200, help="Number of recordings.")
    parser.add_argument("--seed", type=int, default=0, help="Chooses the family of recordings.")
    parser.add_argument("--jobs", type=int, default=1, help="Number of processes.")
    parser.add_argument("--frames", type=int, nargs=2, default=(60, 1500), help="Fewest and most frames.")
    arguments = parser.parse_args()
    drawn = recordings(arguments.recordings, arguments.seed, arguments.frames, measured_responses())
    calls = {one.name: partial(row, one) for one in drawn}
    rows = measured(calls, arguments.results, arguments.jobs)
    print(table_of("Recordings without faults", rows, _COLUMNS))
    print(summary(rows))


if __name__ == "__main__":
    main()
