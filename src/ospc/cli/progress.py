"""A progress bar over frames, on standard error."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def progress_bar(stage: str, total: int, *, visible: bool) -> Iterator[Callable[[int, int], None]]:
    """Yield a function that shows how many frames are done, or does nothing if the bar is not visible."""
    if not visible:
        yield lambda _done, _total: None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(stage, total=total)
        yield lambda done, _total: bar.update(task, completed=done)
