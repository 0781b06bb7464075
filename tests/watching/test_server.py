"""Who may ask the page for what."""

from __future__ import annotations

import http.client
import re
from collections.abc import Iterator

import pytest

from trailmark.errors import ConfigError
from trailmark.watching.page import watch_page
from trailmark.watching.server import PageServer, listen

SECRET = "not-guessed"


class ServedPage:
    """What is shown, and what was pressed."""

    def __init__(self) -> None:
        self.pressed: list[str] = []

    def page(self) -> tuple[str, str]:
        return watch_page("a <b>run</b>", SECRET, ["stop"])

    def state(self, after: int) -> bytes | None:
        return None if after >= 3 else b'{"number":3}'

    def picture(self, name: str) -> bytes | None:
        return b"jpeg" if name == "eye_1.00s.jpg" else None

    def report(self) -> bytes | None:
        return None

    def press(self, button: str) -> str:
        self.pressed.append(button)
        return "" if button == "stop" else f"there is no button {button!r}"


@pytest.fixture
def server() -> Iterator[PageServer]:
    server = PageServer(listen(0), SECRET, ServedPage())
    server.start()
    yield server
    server.stop()


def ask(
    server: PageServer, path: str, method: str = "GET", body: bytes | None = None, **headers: str
) -> tuple[int, http.client.HTTPMessage, str]:
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=20)
    named = {name.replace("_", "-"): value for name, value in headers.items()}
    connection.request(method, path, body=body, headers=named)
    answer = connection.getresponse()
    text = answer.read().decode()
    connection.close()
    return answer.status, answer.headers, text


def test_the_page_asks_its_own_server_alone(server: PageServer) -> None:
    status, headers, text = ask(server, f"/{SECRET}/")

    policy = headers["Content-Security-Policy"]
    assert status == 200
    assert policy.startswith("default-src 'none';")
    assert "connect-src 'self'" in policy
    assert "frame-ancestors 'none'" in policy
    assert len(re.findall(r"'sha256-", policy)) == 2
    assert "unsafe-inline'; img" in policy  # for styles; scripts are named by their hashes
    assert "script-src 'unsafe" not in policy
    assert headers["Cache-Control"] == "no-store"
    assert headers["Referrer-Policy"] == "no-referrer"
    assert "<b>run</b>" not in text
    assert not re.findall(r"https?://(?!www\.w3\.org/2000/svg)", text)


def test_state_pictures_and_what_is_not_there(server: PageServer) -> None:
    assert ask(server, f"/{SECRET}/state?after=-1")[::2] == (200, '{"number":3}')
    assert ask(server, f"/{SECRET}/state?after=3")[0] == 204
    assert ask(server, f"/{SECRET}/state?after=x")[0] == 200
    assert ask(server, f"/{SECRET}/pictures/eye_1.00s.jpg")[::2] == (200, "jpeg")
    for path in ("pictures/../run.json", "pictures/%2e%2e/run.json", "report.html", "other", "press/stop"):
        assert ask(server, f"/{SECRET}/{path}")[0] == 404


@pytest.mark.parametrize(
    ("path", "headers"),
    [
        (f"/{SECRET}/", {"Host": "evil.example"}),
        (f"/{SECRET}/", {"Host": "evil.example:80"}),
        (f"/{SECRET}/state", {"Origin": "http://evil.example"}),
        (f"/{SECRET}/state", {"Origin": "null"}),
        (f"/{SECRET}/state", {"Sec_Fetch_Site": "cross-site"}),
        (f"/{SECRET}/state", {"Sec_Fetch_Site": "same-site"}),
        ("/", {}),
        ("/state", {}),
        ("/not-guesse/state", {}),
        ("//", {}),
    ],
)
def test_others_get_nothing(server: PageServer, path: str, headers: dict[str, str]) -> None:
    status, _, text = ask(server, path, **headers)

    assert status == 403
    assert SECRET not in text


def test_a_button_needs_the_token_and_this_page(server: PageServer) -> None:
    token = {"X_Trailmark_Token": SECRET}

    assert ask(server, f"/{SECRET}/press/stop", "POST")[0] == 403
    assert ask(server, f"/{SECRET}/press/stop", "POST", X_Trailmark_Token="guess")[0] == 403
    assert ask(server, f"/{SECRET}/press/stop", "POST", **token, Origin="http://evil.example")[0] == 403
    assert ask(server, f"/{SECRET}/press/stop", "POST", **token, Host="evil.example")[0] == 403
    assert ask(server, f"/{SECRET}/press/stop", "POST", b"a word", **token)[0] == 413
    assert ask(server, f"/{SECRET}/other", "POST", **token)[0] == 404
    assert server.shown.pressed == []

    local = f"http://127.0.0.1:{server.port}"
    assert ask(server, f"/{SECRET}/press/stop", "POST", **token, Origin=local)[0] == 204
    assert ask(server, f"/{SECRET}/press/teach", "POST", **token)[::2] == (409, "there is no button 'teach'")
    assert server.shown.pressed == ["stop", "teach"]
    for method in ("PUT", "DELETE", "OPTIONS"):
        assert ask(server, f"/{SECRET}/press/stop", method, **token)[0] == 501


def test_it_listens_on_this_machine_alone_and_a_taken_port_is_a_line(server: PageServer) -> None:
    assert server.server_address[0] == "127.0.0.1"
    with pytest.raises(ConfigError, match=rf"^--port {server.port}: Address already in use; leave it out"):
        listen(server.port)
