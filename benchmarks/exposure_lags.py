"""Put known lags on the exposures of simulated recordings, and ask whether they are found.

    python benchmarks/exposure_lags.py --work /tmp/lags --seeds 3
    python benchmarks/exposure_lags.py --work /tmp/lags --kinds auto sweep --frames 80 --lags -2 0 2

A positive lag means that metadata come late: a frame is given the exposure of an earlier one. There are four
outcomes:

found         the exposures were moved by just the lag (with lag 0, left alone)
undetermined  they were left where they were, and a verdict or a warning says that they can't be relied on
missed        they were left where they were, and nothing was said
wrong         they were moved by another number of frames

Recordings are rendered once and kept in the folder --work, which holds the results too: an interrupted run goes
on where it stopped.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from ospc import calibrate
from ospc.arrays import FloatArray
from ospc.research.source import SimulatedSource
from ospc.simulation import SimulationSettings, truth
from results import Row, measured, table_of
from simulated_family import errors, relinked, rendered

LENGTHS = (80, 400)
LAGS = (-3, -2, -1, 0, 1, 2, 3)
KINDS = ("auto", "flicker", "quantised", "jitter", "sweep")
_RESPONSES = ("srgb", "gamma2.2", "filmic", "linear", "log")
_STEP, _JITTER, _SWEEP_FRAMES = 2 ** (1 / 3), 0.01, 60
"""Factor between the exposures of a camera with third stops, standard deviation of the metadata's relative error, and
frames from the shortest exposure to the longest and back."""

_COLUMNS = ("recording", "lag", "corrected", "outcome", "V", "shape", "kappa", "states")


def member(kind: str, frames: int, seed: int) -> SimulatedSource:
    """Return a recording whose exposures run in some way; its metadata have no lag."""
    number, noise = KINDS.index(kind), ("low", "high")[seed % 2]
    settings = SimulationSettings(size=(320, 240), frames=frames, seed=500 + 10 * seed + number, noise=noise)
    settings = replace(settings, response=_RESPONSES[(seed + number) % len(_RESPONSES)])
    if kind == "flicker":
        settings = replace(settings, flicker=0.1)
    if kind == "jitter":
        settings = replace(settings, metadata_error=_JITTER)
    if kind == "quantised":
        settings = _programmed(settings, _quantised(truth(settings).exposures_ms))
    if kind == "sweep":
        triangle = np.abs(np.arange(frames) % _SWEEP_FRAMES / (_SWEEP_FRAMES / 2) - 1)
        settings = _programmed(settings, 3.0 * 8.0**triangle)
    return SimulatedSource(f"{kind}-{frames}-{seed}", settings)


def _quantised(exposures_ms: FloatArray) -> FloatArray:
    """Return third stops, each kept until the exposure wanted is nearer to the next but one."""
    steps = np.log(exposures_ms) / np.log(_STEP)
    kept = [round(float(steps[0]))]
    for step in steps[1:]:
        kept.append(kept[-1] if abs(step - kept[-1]) < 0.75 else round(float(step)))
    return np.asarray(_STEP ** np.array(kept, dtype=np.float64))


def _programmed(settings: SimulationSettings, exposures_ms: FloatArray) -> SimulationSettings:
    return replace(settings, exposure="file", exposures_ms=tuple(exposures_ms.round(6).tolist()))


def examined(original: Path, settings: SimulationSettings, lag: int) -> Row:
    def late(exposures_ms: FloatArray) -> FloatArray:
        return exposures_ms[np.clip(np.arange(exposures_ms.size) - lag, 0, exposures_ms.size - 1)]

    with tempfile.TemporaryDirectory(dir=original.parent) as folder:
        found = calibrate(relinked(original, Path(folder) / original.name, late))
    corrected = int(found.source.get("exposure_lag_corrected_frames", 0))
    # The response is nothing but what exposures say.
    doubted = found.verdicts["response"].state != "identifiable"
    if corrected == lag:
        outcome = "found"
    elif corrected:
        outcome = "wrong"
    else:
        outcome = "undetermined" if doubted else "missed"
    states = " ".join(f"{name}:{verdict.state}" for name, verdict in found.verdicts.items())
    reasons = {name: verdict.reason for name, verdict in found.verdicts.items()}
    lags = {"lag": lag, "corrected": corrected, "outcome": outcome, "doubted": doubted}
    return {"recording": original.name, **lags, **errors(found, settings), "states": states, "reasons": reasons}


def summaries(rows: Sequence[Row]) -> list[Row]:
    cases: dict[str, list[Row]] = {}
    for row in rows:
        cases.setdefault(row["recording"].rpartition("-")[0], []).append(row)
    result = []
    for case, members in cases.items():
        counts = Counter(row["outcome"] for row in members)
        kappas = [row["kappa"] for row in members if row["kappa"] is not None]
        outcomes = {outcome: counts[outcome] for outcome in ("found", "undetermined", "missed", "wrong")}
        kappa = {
            "median kappa": statistics.median(kappas) if kappas else None,
            "worst kappa": max(kappas, default=None),
        }
        result.append({"case": case, "runs": len(members), **outcomes, **kappa})
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--work", type=Path, required=True, help="Folder for the recordings and the results.")
    parser.add_argument("--seeds", type=int, default=3, help="Recordings of each kind and length.")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS), help="How the exposures run.")
    parser.add_argument("--frames", type=int, nargs="+", default=list(LENGTHS), help="Lengths of the recordings.")
    parser.add_argument("--lags", type=int, nargs="+", default=list(LAGS), help="Lags in frames.")
    arguments = parser.parse_args()
    members = [
        member(kind, frames, seed)
        for frames in arguments.frames
        for kind in arguments.kinds
        for seed in range(arguments.seeds)
    ]
    places = rendered(members, arguments.work / "recordings")
    calls = {
        f"{one.name} {lag:+d}": partial(examined, places[one.name], one.settings, lag)
        for one in members
        for lag in arguments.lags
    }
    rows = measured(calls, arguments.work / "results")
    print(table_of("Lags", rows, _COLUMNS))
    outcomes = summaries(rows)
    print(table_of("Outcomes", outcomes, list(outcomes[0])))


if __name__ == "__main__":
    main()
