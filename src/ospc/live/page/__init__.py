"""The page of a guided capture, and the server that shows it on this machine only."""

from __future__ import annotations

from ospc.live.page.server import PageServer

__all__ = ["PageServer"]
