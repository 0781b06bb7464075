"""The page in a real browser, where there is one: it goes with the run, and keeps how it is looked at."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from trailmark.watching.page import watch_page
from trailmark.watching.server import PageServer, listen

BROWSER = next(
    (path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), None
)
SECRET = "not-guessed"
PROBE = Path(__file__).with_name("probe.js").read_text(encoding="utf-8")


class ServedPage:
    """A run that is further at the second look, and has ended when Stop was pressed."""

    def __init__(self, documents: list[dict]) -> None:
        self.documents = documents
        self.pressed: list[str] = []
        self.asked: list[str] = []

    def page(self) -> tuple[str, str]:
        text, policy = watch_page("a run", SECRET, ["stop"])
        probe = f"<script nonce='probe'>{PROBE}</script>"
        return text.replace("</head>", f"{probe}</head>").replace(
            "script-src ", "script-src 'nonce-probe' "
        ), policy.replace("script-src ", "script-src 'nonce-probe' ")

    def state(self, after: int) -> bytes | None:
        number = 2 if self.pressed else min(after + 1, 1)
        if number == after:
            return None
        is_over = number == 2
        state = {
            "number": number,
            "name": "a <b>run</b>",
            "run": "out",
            "status": "ended: interrupted" if is_over else "running",
            "isLive": not is_over,
            "isOver": is_over,
            "note": "",
            "can": [] if is_over else ["stop"],
            "explorer": self.documents[number],
            "health": {"columns": [{"title": "localizer", "unit": "", "number": False}], "rows": [["<i>wheels</i>"]]},
            "pictures": [{"sensor": "eye", "t": 1.0, "name": "eye_1.00s.jpg"}],
            "hasReport": is_over,
        }
        return json.dumps(state).encode()

    def picture(self, name: str) -> bytes | None:
        self.asked.append(name)
        return b"jpeg"

    def report(self) -> bytes | None:
        self.asked.append("report")
        return b"<p>report</p>"

    def press(self, button: str) -> str:
        self.pressed.append(button)
        return ""


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="no chromium to open the page with")
def test_the_page_goes_with_the_run_and_keeps_how_it_is_looked_at(watched, tmp_path: Path) -> None:
    first = watched.document
    longer = json.loads(json.dumps(first)) | {"span": first["span"] + 1.0}
    shown = ServedPage([first, longer, longer | {"isGoingOn": False}])
    server = PageServer(listen(0), SECRET, shown)
    server.start()
    try:
        found = browse(server.url, tmp_path)
    finally:
        server.stop()

    assert found["errors"] == []
    assert found["live"] == ["running", True, False]  # Stop can be pressed
    assert found["tracks"] == 3
    assert found["follows"] == [first["span"], longer["span"]]
    assert found["zoom_kept"]
    assert found["hidden_kept"]
    assert found["cursor_kept"]
    assert found["text"] == ["a <b>run</b>", "<i>wheels</i>"]
    assert found["pictures"] == 1
    assert found["ended"] == ["ended: interrupted", False, True]
    assert found["report"].startswith("blob:http://127.0.0.1")
    assert shown.pressed == ["stop"]
    assert shown.asked == ["eye_1.00s.jpg", "report"]  # once each


def browse(url: str, tmp_path: Path) -> dict:
    assert BROWSER is not None
    command = [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--window-size=900,1200"]
    command += ["--disable-background-networking", "--disable-component-update", "--disable-sync"]
    command += [f"--user-data-dir={tmp_path / 'browser'}", "--virtual-time-budget=60000", "--dump-dom", url]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    told = re.search(r"PROBE(\{.*?\})END", done.stdout)
    assert told is not None, done.stdout[-2000:]
    found: dict = json.loads(told[1].replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&"))
    return found
