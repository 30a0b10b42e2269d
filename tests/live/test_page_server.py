"""Only the user who started the page can open it, not other machines, users or sites."""

from __future__ import annotations

import http.client
import json
import sys

import pytest

from ospc.errors import MissingExtraError, SettingError
from ospc.live.calibrator import LiveCalibrator
from ospc.live.capture import Capture

pytest.importorskip("websockets")

from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from ospc.live.page.server import PageServer


@pytest.fixture(scope="module")
def server():
    with LiveCalibrator() as live, PageServer(Capture(live)) as running:
        yield running


def answer(server, path, host=None):
    """Return status, headers and body of the response."""
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=10)
    connection.putrequest("GET", path, skip_host=True)
    for value in [f"127.0.0.1:{server.port}"] if host is None else host:
        connection.putheader("Host", value)
    connection.endheaders()
    found = connection.getresponse()
    return found.status, found.headers, found.read().decode()


def token(server):
    return server.url.rstrip("/").rpartition("/")[2]


@pytest.mark.parametrize(
    ("name", "kind", "part"),
    [
        ("", "text/html", "<button"),
        ("page.css", "text/css", "prefers-color-scheme"),
        ("page.js", "text/javascript", "WebSocket"),
    ],
)
def test_its_files_are_shown_with_strict_headers(server, name, kind, part):
    status, headers, body = answer(server, f"/{token(server)}/{name}")
    assert status == 200
    assert part in body
    assert headers.get_all("Content-Type") == [f"{kind}; charset=utf-8"]
    policy = headers["Content-Security-Policy"]
    assert policy.startswith("default-src 'none'")
    assert "unsafe" not in policy
    assert "http" not in policy
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert headers["Referrer-Policy"] == "no-referrer"


@pytest.mark.parametrize("path", ["/", "/page.js", "/favicon.ico", "//", "/{almost}/", "/{token}x/", "/../{token}/"])
def test_without_the_token_nothing_is_shown(server, path):
    known = token(server)
    status, _, body = answer(server, path.format(token=known, almost=known[:-1]))
    assert (status, known in body) == (403, False)


@pytest.mark.parametrize(
    "host", [["evil.example"], ["evil.example:{port}"], [], ["127.0.0.1"], ["127.0.0.1:{port}", "evil.example"]]
)
def test_under_another_name_nothing_is_shown(server, host):
    """A site that resolves its own name to this machine sends that name."""
    named = [name.format(port=server.port) for name in host]
    assert answer(server, f"/{token(server)}/", named)[0] in (400, 403)


@pytest.mark.parametrize("name", ["page.html", "server.py", "..%2fpage.js", "../server.py", "socket/", "page.js/x"])
def test_there_are_no_other_files(server, name):
    assert answer(server, f"/{token(server)}/{name}")[0] == 404


def test_another_site_cannot_listen(server):
    url = server.url.replace("http:", "ws:") + "socket"
    with pytest.raises(InvalidStatus) as refused:
        connect(url, origin="https://evil.example")
    assert refused.value.response.status_code == 403
    with pytest.raises(InvalidStatus):
        connect(f"ws://127.0.0.1:{server.port}/guessed/socket", origin=f"http://127.0.0.1:{server.port}")
    with connect(url, origin=f"http://127.0.0.1:{server.port}") as page:
        assert json.loads(page.recv(5))["frames"] == 0


def test_it_listens_on_this_machine_only(server):
    assert server.url.startswith("http://127.0.0.1:")
    assert server._server.socket.getsockname()[0] == "127.0.0.1"
    assert len(token(server)) >= 32


def test_a_port_in_use_is_reported(server):
    with LiveCalibrator() as live, pytest.raises(SettingError, match=f"port {server.port}"):
        PageServer(Capture(live), server.port)


def test_without_the_package_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "websockets.sync.server", None)
    with LiveCalibrator() as live, pytest.raises(MissingExtraError, match=r"ospc\[live\]"):
        PageServer(Capture(live))
