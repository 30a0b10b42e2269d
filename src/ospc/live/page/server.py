"""Serve the page of a capture on the loopback address to clients that know its token."""

from __future__ import annotations

import hmac
import logging
import secrets
import socket
import threading
from importlib.resources import files
from typing import TYPE_CHECKING, Self

from ospc.errors import SettingError, needs_extra, os_error_as
from ospc.formats.files import json_text
from ospc.live.capture import Capture

if TYPE_CHECKING:
    from websockets.http11 import Request, Response
    from websockets.sync.server import Server, ServerConnection

ADDRESS = "127.0.0.1"

_TOKEN_BYTES = 24
"""Random bytes in the address of the page: 192 bits cannot be guessed."""

_PERIOD_S = 0.15
"""Interval between page updates, in seconds."""

_LAST_WORD_S = 5.0
"""Longest time in seconds that the server waits at the end for pages to receive the final state."""

_ASSETS = {
    "": ("page.html", "text/html; charset=utf-8"),
    "page.css": ("page.css", "text/css; charset=utf-8"),
    "page.js": ("page.js", "text/javascript; charset=utf-8"),
}
_SOCKET = "socket"

_HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}


class PageServer:
    """A page that shows a capture; use it in a ``with`` statement.

    Only requests from this machine with the token and this host name are answered; all others get 403, which keeps
    other users and web pages out. Port 0 selects a free port. SettingError if the port is in use, MissingExtraError
    without the package ``websockets``.
    """

    def __init__(self, capture: Capture, port: int = 0) -> None:
        with needs_extra("the page of a capture", "live"):
            from websockets.sync.server import serve
            from websockets.typing import Origin
        self._capture = capture
        self._token = secrets.token_urlsafe(_TOKEN_BYTES)
        self._stopped = threading.Event()
        self._pages: set[threading.Thread] = set()
        logger = logging.getLogger("ospc.live.page")
        logger.setLevel(logging.CRITICAL)  # a browser that disconnects is not an error
        with os_error_as(SettingError, f"port {port} cannot be used", "choose another one"):
            listening = socket.create_server((ADDRESS, port))
        self.port: int = listening.getsockname()[1]
        self._hosts = {f"{ADDRESS}:{self.port}", f"localhost:{self.port}"}
        self._server: Server = serve(
            self._show,
            sock=listening,
            process_request=self._answer,
            origins=[Origin(f"http://{host}") for host in self._hosts],
            compression=None,
            max_size=1024,
            logger=logger,
        )
        self._thread = threading.Thread(target=self._server.serve_forever, name="ospc-page", daemon=True)

    @property
    def url(self) -> str:
        """Address of the page, with its token."""
        return f"http://{ADDRESS}:{self.port}/{self._token}/"

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Send the final state to all pages, and stop."""
        self._stopped.set()
        for page in tuple(self._pages):
            page.join(_LAST_WORD_S)
        self._server.shutdown()
        self._thread.join()

    def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """Return a file, 403 if the request is not allowed, or None to continue with the WebSocket."""
        token, _, name = request.path.removeprefix("/").partition("/")
        hosts = request.headers.get_all("Host")
        is_ours = len(hosts) == 1 and hosts[0] in self._hosts
        if not (hmac.compare_digest(token.encode(), self._token.encode()) and is_ours):
            return _replied(connection, 403, "forbidden\n")
        if name == _SOCKET:
            return None
        if name not in _ASSETS:
            return _replied(connection, 404, "there is no such page\n")
        file, kind = _ASSETS[name]
        return _replied(connection, 200, files("ospc.live.page").joinpath(file).read_text(encoding="utf-8"), kind)

    def _show(self, connection: ServerConnection) -> None:
        """Send updates to a page until the end, and listen for the request to finish."""
        from websockets.exceptions import ConnectionClosed

        self._pages.add(threading.current_thread())
        try:
            last = False
            while not last:
                last = self._stopped.is_set()
                connection.send(json_text(self._capture.view(), indent=None))
                picture = self._capture.picture()
                if picture is not None:
                    connection.send(picture)
                try:
                    said = connection.recv(timeout=0 if last else _PERIOD_S)
                except TimeoutError:
                    continue
                if said == "finish":
                    self._capture.finish()
        except ConnectionClosed:
            pass  # the page was closed; the capture continues
        finally:
            self._pages.discard(threading.current_thread())


def _replied(
    connection: ServerConnection, status: int, text: str, kind: str = "text/plain; charset=utf-8"
) -> Response:
    response = connection.respond(status, text)
    del response.headers["Content-Type"]
    for name, value in {"Content-Type": kind, **_HEADERS}.items():
        response.headers[name] = value
    return response
