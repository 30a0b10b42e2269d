"""Runs tasks, possibly in parallel, and stores results, so that a study can be interrupted, resumed or extended."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from hashlib import sha256
from pathlib import Path
from typing import Any, TypeAlias

import ospc
from ospc.errors import OspcError
from ospc.formats.files import json_object
from ospc.system.atomic import write_atomically
from ospc.system.folders import writing
from ospc.system.processes import in_processes
from ospc.system.versions import versions

_SCHEMA = "ospc-research-result/1"
_KEY_DIGITS = 24
"""Hexadecimal digits of a key: 96 bits make collisions negligible."""
_WITHOUT_EFFECT = ("cli", "report", "batch", "live", "diagnosis")
"""Parts of the package whose source cannot change the results of methods."""


class ResultStore:
    """JSON results in a folder, one file each.

    A result is found only with the description it was stored with: everything it depends on, as JSON-compatible
    values. The name of its task makes the file names readable.
    """

    def __init__(self, folder: str | Path) -> None:
        self._folder = Path(folder)

    def get(self, name: str, description: dict[str, Any]) -> Any:
        """Return a result; None if there is none or its file is damaged."""
        content = json_object(self._place(name, description))
        return content.get("result") if content.get("schema") == _SCHEMA else None

    def put(self, name: str, description: dict[str, Any], result: Any) -> Path:
        """Store a result and return the path of its file."""
        place = self._place(name, description)
        content = {"schema": _SCHEMA, "name": name, "depends_on": description, "result": result}
        with writing(place):
            place.parent.mkdir(parents=True, exist_ok=True)
            return write_atomically(place, (json.dumps(content, indent=1) + "\n").encode())

    def _place(self, name: str, description: dict[str, Any]) -> Path:
        readable = re.sub(r"[^\w.+-]+", "_", name).strip(".")[:100]
        return self._folder / f"{readable}.{key_of(description)[:_KEY_DIGITS]}.json"


def key_of(description: dict[str, Any]) -> str:
    """Return a hash of everything a result depends on."""
    return sha256(json.dumps(description, sort_keys=True).encode()).hexdigest()


def made_with(*, whole: bool = False) -> dict[str, str]:
    """Return the versions and source hash that results depend on; of the ``whole`` package, or of its methods."""
    libraries = {name: version for name, version in versions().items() if name != "python"}
    return libraries | {"source": source_hash(whole)}


@cache
def source_hash(whole: bool = False) -> str:
    """Return a hash of the package's source, by default without the parts that cannot change its methods' results."""
    root = Path(ospc.__file__).parent
    total = sha256()
    for path in sorted(root.rglob("*.py")):
        part = path.relative_to(root)
        if whole or part.parts[0] not in _WITHOUT_EFFECT:
            total.update(part.as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return total.hexdigest()


OnProgress: TypeAlias = Callable[[float], None]
"""Called repeatedly with the share of a task that is done."""


@dataclass(frozen=True)
class Task:
    """A long computation with a readable name. Tasks are pickled if several run in parallel.

    The result, of JSON-compatible values, depends only on ``depends_on``, which is JSON-compatible too. ``about`` is
    what reports need to know about the task.
    """

    name: str
    depends_on: dict[str, Any]
    compute: Callable[[OnProgress], Any] = field(repr=False)
    about: Any = None


Finished: TypeAlias = tuple[Task, Any]
"""A task and its result."""

OnShare: TypeAlias = Callable[[Task, float], None]
"""Called with the running task and the share of it that is done."""


def run(
    tasks: Sequence[Task], store: ResultStore, jobs: int = 1, on_share: OnShare = lambda _task, _share: None
) -> Iterator[Finished]:
    """Yield every task with its result: stored ones first, then the others as they finish.

    Each result is stored before it is yielded, so an interruption loses only the running tasks. Ending the iteration
    early ends all worker processes and the programs they started. With one job, everything runs in this process, and
    ``on_share`` is called while a task runs.
    """
    missing: list[Task] = []
    for task in tasks:
        result = store.get(task.name, task.depends_on)
        if result is None:
            missing.append(task)
        else:
            yield task, result
    if jobs == 1 or len(missing) < 2:
        computed = ((task, task.compute(partial(on_share, task))) for task in missing)
    else:
        computed = in_processes(_compute, missing, jobs, _lost)
    for task, result in computed:
        store.put(task.name, task.depends_on, result)
        yield task, result


def _compute(task: Task) -> Any:
    """Compute a result in a process of its own, on one core."""
    import cv2

    cv2.setNumThreads(1)
    return task.compute(lambda _share: None)


def _lost(task: Task, why: str) -> Any:
    raise OspcError(f"{task.name}: {why}; run the command again to continue")
