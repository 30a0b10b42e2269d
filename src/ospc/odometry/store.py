"""Finished runs on disk: found again only for the same images, parameters, program and number of the run."""

from __future__ import annotations

import json
from hashlib import sha256
from pathlib import Path

import numpy as np

from ospc.atomic import write_atomically
from ospc.errors import FormatError, SettingError
from ospc.evaluation.trajectory import Trajectory, read_trajectory
from ospc.odometry.inputs import OdometryInput
from ospc.odometry.run import Odometry, Tracked

_SCHEMA = "ospc-odometry-run/1"


class RunStore:
    """Runs in a folder, made when the first is put there.

    What is kept is what the program left behind, not its errors: those are computed anew from the truth.

    Parameters
    ----------
    folder
        Where.
    """

    def __init__(self, folder: str | Path) -> None:
        self._folder = Path(folder)

    def key(self, source: OdometryInput, odometry: Odometry, run: int) -> str:
        """Return a hash of all that a run depends on."""
        content = {"input": source.fingerprint(), "odometry": odometry.fingerprint(), "run": run, "schema": _SCHEMA}
        return sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:24]

    def get(self, key: str) -> Tracked | None:
        """Return a run; None where there is none, or it cannot be read."""
        note, poses = self._folder / f"{key}.json", self._folder / f"{key}.txt"
        try:
            content = json.loads(note.read_text(encoding="utf-8"))
            if content["schema"] != _SCHEMA:
                return None
            trajectory = read_trajectory(poses) if content["poses"] else None
            return Tracked(
                trajectory,
                str(content["failure"]),
                bool(content["timeout"]),
                str(content["log"]),
                float(content["seconds"]),
            )
        except (OSError, ValueError, KeyError, TypeError, RecursionError, FormatError):
            return None

    def put(self, key: str, tracked: Tracked) -> None:
        """Keep a run; the note comes last, so that an interruption leaves nothing that looks finished.

        Raises
        ------
        SettingError
            If it cannot be written.
        """
        content = {
            "schema": _SCHEMA,
            "poses": 0 if tracked.trajectory is None else len(tracked.trajectory),
            "failure": tracked.failure,
            "timeout": tracked.timeout,
            "seconds": tracked.seconds,
            "log": tracked.log,
        }
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            if tracked.trajectory is not None:
                write_atomically(self._folder / f"{key}.txt", _rows(tracked.trajectory))
            write_atomically(self._folder / f"{key}.json", json.dumps(content, indent=1).encode())
        except OSError as error:
            raise SettingError(
                f"{self._folder}: cannot be written ({error.strerror}); choose another folder"
            ) from None


def _rows(trajectory: Trajectory) -> bytes:
    table = np.column_stack([trajectory.stamps_s, trajectory.positions, trajectory.quaternions])
    return "".join(" ".join(f"{value:.17g}" for value in row) + "\n" for row in table).encode()
