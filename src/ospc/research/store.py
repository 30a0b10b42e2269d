"""Results on disk, so that a study can be interrupted, resumed, and repeated only where something changed."""

from __future__ import annotations

import json
import re
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

import ospc
from ospc.atomic import write_atomically
from ospc.errors import SettingError
from ospc.versions import versions

_SCHEMA = "ospc-research-result/1"
_KEY_DIGITS = 24
"""Hexadecimal digits of a key: 96 bits, far more than any number of results needs."""

_WITHOUT_EFFECT = ("cli", "report", "batch", "live", "diagnosis")
"""Parts of the package whose source cannot change a result."""


class ResultStore:
    """JSON results in a folder, one file each, found again only under the key they were stored with.

    A result has the name of its task, for people who look into the folder, and a description: everything it depends
    on, as JSON-compatible values.
    """

    def __init__(self, folder: str | Path) -> None:
        self._folder = Path(folder)

    def get(self, name: str, description: dict[str, Any]) -> Any:
        """Return a result; None where there is none, or its file is damaged."""
        try:
            content = json.loads(self._place(name, description).read_text(encoding="utf-8"))
            return content["result"] if content["schema"] == _SCHEMA else None
        except (OSError, ValueError, KeyError, TypeError, RecursionError):
            return None

    def put(self, name: str, description: dict[str, Any], result: Any) -> Path:
        """Store a result and return the path of its file."""
        place = self._place(name, description)
        content = {"schema": _SCHEMA, "name": name, "depends_on": description, "result": result}
        try:
            place.parent.mkdir(parents=True, exist_ok=True)
            return write_atomically(place, (json.dumps(content, indent=1) + "\n").encode())
        except OSError as error:
            raise SettingError(f"{place}: cannot be written ({error.strerror}); choose another folder") from None

    def _place(self, name: str, description: dict[str, Any]) -> Path:
        readable = re.sub(r"[^\w.+-]+", "_", name).strip(".")[:100]
        return self._folder / f"{readable}.{key_of(description)[:_KEY_DIGITS]}.json"


def key_of(description: dict[str, Any]) -> str:
    """Return a hash of everything a result depends on."""
    return sha256(json.dumps(description, sort_keys=True).encode()).hexdigest()


def made_with() -> dict[str, str]:
    """Return the versions and the source that results of this package's own methods depend on."""
    return {name: version for name, version in versions().items() if name != "python"} | {"source": source_hash()}


@cache
def source_hash() -> str:
    """Return a hash of the package's source, without the parts that cannot change a result."""
    root = Path(ospc.__file__).parent
    total = sha256()
    for path in sorted(root.rglob("*.py")):
        part = path.relative_to(root)
        if part.parts[0] not in _WITHOUT_EFFECT:
            total.update(part.as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return total.hexdigest()
