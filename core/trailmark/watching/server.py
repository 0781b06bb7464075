"""A page on this machine alone: who may ask for it, and for what."""

from __future__ import annotations

import hmac
import secrets
import socket
import threading
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Protocol
from urllib.parse import parse_qs, urlsplit

from trailmark import __version__
from trailmark.errors import ConfigError

__all__ = ["HOST", "PageServer", "ServedPage", "listen", "new_secret"]

HOST = "127.0.0.1"
_NAMES = (HOST, "localhost")
_TOKEN = "X-Trailmark-Token"
_PATIENCE_S = 10.0
_HEADERS = {
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
}


class ServedPage(Protocol):
    """What a page shows, and what its buttons do; asked from several threads."""

    def page(self) -> tuple[str, str]:
        """Return the page, and the policy that its browser is to keep."""

    def state(self, after: int) -> bytes | None:
        """Return what is to be shown now, as JSON; None: nothing newer than the state of that number."""

    def picture(self, name: str) -> bytes | None:
        """Return a picture; None: there is none of that name."""

    def report(self) -> bytes | None:
        """Return the report of the run; None: there is none yet."""

    def press(self, button: str) -> str:
        """Do what a button says; return why not, empty where it is done."""


def new_secret() -> str:
    """Return a random word for the page's address: requests without it are refused."""
    return secrets.token_urlsafe(18)


def listen(port: int) -> socket.socket:
    """Return a socket that listens on this machine alone.

    Parameters
    ----------
    port : int
        0: one that is free.

    Raises
    ------
    ConfigError
        If the port is taken.
    """
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((HOST, port))
        listener.listen(16)
    except OSError as error:
        listener.close()
        raise ConfigError(f"--port {port}: {error.strerror or error}; leave it out for a free one") from error
    return listener


class PageServer(ThreadingHTTPServer):
    """Answers requests for one page, in threads of its own.

    A request is answered when its ``Host`` names this machine, when its path begins with the secret, and, if it comes
    from a page, when that page is this one: another page that the browser has open, whatever name it has the browser
    look up, gets nothing. Buttons need the secret in a header as well, which no foreign page can set.

    Parameters
    ----------
    listener : socket.socket
        Listens already.
    secret : str
        In the page's address.
    shown : ServedPage
        What it shows.
    """

    daemon_threads = True

    def __init__(self, listener: socket.socket, secret: str, shown: ServedPage) -> None:
        super().__init__((HOST, 0), _Handler, bind_and_activate=False)
        self.socket.close()
        self.socket = listener
        self.server_address = listener.getsockname()
        self.secret, self.shown = secret, shown

    @property
    def port(self) -> int:
        """Where it listens."""
        return int(self.server_address[1])

    @property
    def url(self) -> str:
        """What to open."""
        return url_of(self.port, self.secret)

    def start(self) -> None:
        """Answer, until `stop`."""
        threading.Thread(target=self.serve_forever, args=(0.1,), name="page", daemon=True).start()

    def stop(self) -> None:
        """Answer no more; requests that are being answered are."""
        self.shutdown()
        self.server_close()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore errors of connections that a browser has closed."""


def url_of(port: int, secret: str) -> str:
    """Return the address of a page."""
    return f"http://{HOST}:{port}/{secret}/"


class _Handler(BaseHTTPRequestHandler):
    server: PageServer
    server_version = f"Trailmark/{__version__}"
    sys_version = ""
    timeout = _PATIENCE_S

    def do_GET(self) -> None:
        where = self._path_below()
        if where is None:
            return
        shown = self.server.shown
        if where == "":
            text, policy = shown.page()
            self._answer(text.encode(), "text/html; charset=utf-8", {"Content-Security-Policy": policy})
        elif where == "state":
            state = shown.state(self._after())
            self._answer(state, "application/json") if state is not None else self._say(HTTPStatus.NO_CONTENT)
        elif where.startswith("pictures/"):
            self._answer(shown.picture(where.removeprefix("pictures/")), "image/jpeg")
        elif where == "report.html":
            self._answer(shown.report(), "text/html; charset=utf-8")
        else:
            self._say(HTTPStatus.NOT_FOUND, "there is no such page")

    def do_POST(self) -> None:
        where = self._path_below()
        if where is None:
            return
        if not hmac.compare_digest(self.headers.get(_TOKEN, "").encode(), self.server.secret.encode()):
            self._say(HTTPStatus.FORBIDDEN, f"a button is pressed with the header {_TOKEN}")
        elif self.headers.get("Content-Length", "0") != "0" or "Transfer-Encoding" in self.headers:
            self._say(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "a button says nothing else")
        elif not where.startswith("press/"):
            self._say(HTTPStatus.NOT_FOUND, "there is no such button")
        else:
            refusal = self.server.shown.press(where.removeprefix("press/")[:40])
            self._say(HTTPStatus.CONFLICT if refusal else HTTPStatus.NO_CONTENT, refusal)

    def _path_below(self) -> str | None:
        """Return what is asked for, below the secret; None: it was refused."""
        hosts = [f"{name}:{self.server.port}" for name in _NAMES]
        if self.headers.get("Host", "") not in hosts:
            self._say(HTTPStatus.FORBIDDEN, f"this page is at {hosts[0]} alone")
            return None
        origin = self.headers.get("Origin")
        if origin is not None and origin not in [f"http://{host}" for host in hosts]:
            self._say(HTTPStatus.FORBIDDEN, "this page does not answer to other pages")
            return None
        if self.headers.get("Sec-Fetch-Site", "none") not in ("none", "same-origin"):
            self._say(HTTPStatus.FORBIDDEN, "open the address that the command printed, not a link to it")
            return None
        _, first, *rest = [*urlsplit(self.path).path.split("/"), "", ""]
        if not hmac.compare_digest(first.encode(), self.server.secret.encode()):
            self._say(HTTPStatus.FORBIDDEN, "open the whole address that the command printed")
            return None
        return "/".join(rest).rstrip("/")

    def _after(self) -> int:
        text = parse_qs(urlsplit(self.path).query).get("after", ["-1"])[0]
        return int(text) if text.isdecimal() and len(text) < 16 else -1

    def _answer(self, content: bytes | None, kind: str, headers: dict[str, str] | None = None) -> None:
        if content is None:
            self._say(HTTPStatus.NOT_FOUND, "it is not there")
            return
        self._send(HTTPStatus.OK, content, {"Content-Type": kind, **(headers or {})})

    def _say(self, status: HTTPStatus, text: str = "") -> None:
        self._send(status, text.encode(), {"Content-Type": "text/plain; charset=utf-8"})

    def _send(self, status: HTTPStatus, content: bytes, headers: dict[str, str]) -> None:
        self.send_response(status)
        for name, value in (_HEADERS | headers).items():
            self.send_header(name, value)
        if status != HTTPStatus.NO_CONTENT:
            self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - as the library calls it
        """Keep the terminal for the run."""
