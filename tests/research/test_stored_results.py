"""The results that the programs in ``benchmarks`` store belong to the recordings they were measured on."""

from __future__ import annotations

import importlib
from functools import partial
from pathlib import Path

import pytest

from ospc import Response
from ospc.research.source import SimulatedSource
from ospc.simulation import SimulationSettings

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


def test_a_stored_result_is_used_for_the_same_recording_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(BENCHMARKS)
    program, called = importlib.import_module("results"), list[SimulatedSource]()

    def row(source: SimulatedSource) -> dict[str, object]:
        called.append(source)
        return {}

    # The same name, as with another range of lengths or other measured responses.
    settings = (SimulationSettings(size=(32, 24), frames=count, response=Response.gamma(1.5)) for count in (3, 4, 3))
    for source in (SimulatedSource("0-001", each) for each in settings):
        program.measured({source.name: partial(row, source)}, tmp_path)
    assert [source.count for source in called] == [3, 4]
