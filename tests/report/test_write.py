from __future__ import annotations

import hashlib
import json
import re
import subprocess
import sys
from base64 import b64encode
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from trailmark.errors import DataError
from trailmark.report import write_report
from trailmark.report.html import counters_html
from trailmark.report.style import css_variables

Write = Callable[..., Path]

PLOTS = {"trajectories.svg", "errors.svg", "distribution.svg", "outcomes.svg"}
VOID = {"meta", "br", "img", "input"}
#: The map and the time axis, which the script fills.
EXPLORER = 2
NASTY = "</style><script>alert(1)</script><img src='http://example.org/x.png' onerror=alert(1)>"


class Page(HTMLParser):
    """Tags, attributes and text of a page; refuses tags that are closed in the wrong order."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.urls: list[str] = []
        self.texts: list[str] = []
        self._open: list[str] = []
        self.feed(text)
        assert self._open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.urls += [value or "" for name, value in attrs if name in ("src", "href", "xlink:href", "action")]
        if tag not in VOID:
            self._open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self._open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.texts.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.texts).split())


def _page(folder: Path) -> Page:
    return Page(write_report(folder).read_text(encoding="utf-8"))


def test_a_run_gets_four_plots_and_a_page_with_every_section(fake_run: Write) -> None:
    folder = fake_run(seconds=20.0)

    page = _page(folder)

    assert {path.name for path in (folder / "plots").iterdir()} == PLOTS
    assert page.tags.count("svg") == 4 + EXPLORER
    for words in (
        "20261120-094107-course",
        "Errors against ground truth",
        "Trajectories",
        "Errors over time",
        "Estimates over time",
        "Time per stage",
        "Counters",
        "mailbox.floor_map.overwritten 17",
        "Configuration",
        "estimator: {plugin: kalman, use: [floor, floor_map]}",
        "Provenance",
        "AMD EPYC 7763 64-Core Processor",
        "ate_rmse_m[se2,n=400]",
        "20 November 2026, 09:41 UTC",
    ):
        assert words in page.text


def test_plots_are_svg_with_text_as_text_and_units(fake_run: Write) -> None:
    folder = fake_run(seconds=20.0)
    write_report(folder)

    texts = {
        path.name: " ".join(
            "".join(element.itertext()) for element in ET.parse(path).iter() if element.tag.endswith("}text")
        )
        for path in (folder / "plots").iterdir()
    }

    assert "x [m]" in texts["trajectories.svg"]
    assert "groundtruth" in texts["trajectories.svg"]
    assert "Position error [mm]" in texts["errors.svg"]
    assert "Heading error [°]" in texts["errors.svg"]
    assert "floor_map" in texts["outcomes.svg"]
    assert "[mm], logarithmic" in texts["distribution.svg"]


def test_the_same_run_gives_the_same_bytes(fake_run: Write) -> None:
    folder = fake_run(seconds=10.0)

    first = {path: path.read_bytes() for path in [write_report(folder), *(folder / "plots").iterdir()]}
    write_report(folder)

    assert {path: path.read_bytes() for path in first} == first


def test_the_page_fetches_nothing(fake_run: Write) -> None:
    folder = fake_run(seconds=10.0)

    page = _page(folder)

    assert all(url.startswith("#") for url in page.urls)
    text = (folder / "report.html").read_text(encoding="utf-8")
    assert not re.search(r"@import|url\((?!#)", text)
    assert "default-src 'none'" in text
    assert not {"link", "iframe", "object"} & set(page.tags)


def test_every_heading_of_the_page_says_what_it_means_on_hover(fake_run: Write) -> None:
    text = write_report(fake_run(seconds=10.0)).read_text(encoding="utf-8")

    headings = re.findall(r'<th scope="col"([^>]*)>([^<]*)', text)
    assert len(headings) > 20
    assert [title for attributes, title in headings if "title=" not in attributes] == []


def test_counters_of_the_run_say_what_they_count() -> None:
    told = counters_html({"estimator.repaired_too_certain": 3, "localizer.floor.lost": 0, "localizer.x.own.looks": 1})

    assert '<li title="Estimates that claim to be surer' in told
    assert 'class="zero" title="The localizer looked' in told
    assert "<li><span>localizer.x.own.looks</span>" in told


def test_the_one_script_of_the_page_is_ours_and_the_policy_names_it(fake_run: Write) -> None:
    text = write_report(fake_run(seconds=10.0)).read_text(encoding="utf-8")

    data, script = re.findall(r"<script([^>]*)>(.*?)</script>", text, re.DOTALL)

    digest = b64encode(hashlib.sha256(script[1].encode()).digest()).decode()
    assert data[0] == ' type="application/json" id="explorer-data"'
    assert script[0] == ""
    assert f"script-src 'sha256-{digest}'" in text
    assert not re.search(r"\son\w+=", text.replace(script[1], ""))
    assert not re.search(
        r"innerHTML|insertAdjacentHTML|\beval\b|new Function|fetch\(|https?:(?!//www.w3.org)", script[1]
    )


def test_what_comes_from_a_run_is_text_not_markup(fake_run: Write) -> None:
    folder = fake_run(
        name="a<b>&'\"", seconds=10.0, config=f"# {NASTY}\n", reason=NASTY, status="failed", localizers=("a<i>", "b&c")
    )
    run = json.loads((folder / "run.json").read_text())
    run["counters"] = {NASTY.replace("/", "_"): 3}
    run["packages"] = {"<u>": NASTY}
    (folder / "run.json").write_text(json.dumps(run))

    page = _page(folder)

    assert not {"img", "u", "b"} & set(page.tags)
    assert page.tags.count("script") == 2
    assert page.tags.count("i") == 6  # the legend of the map's colours
    assert page.text.count("<script>alert(1)</script>") >= 3
    assert "a<b>&'\"" in page.text


def test_drawings_inside_the_page_follow_the_colours_of_the_screen(fake_run: Write) -> None:
    folder = fake_run(seconds=10.0)
    text = write_report(folder).read_text(encoding="utf-8")

    drawings = text[text.index('<div class="plots">') : text.index("<h2>Estimates</h2>")]
    drawings += text[text.index('<section id="explorer"') : text.index("<h2>Errors against ground truth</h2>")]

    used = set(re.findall(r"var\((--[a-z0-9-]+)\)", drawings))
    defined = set(re.findall(r"(--[a-z0-9-]+):", css_variables()))
    assert used
    assert used <= defined
    assert not re.findall(r"#[0-9a-f]{6}\b", drawings)
    assert "prefers-color-scheme: dark" in text
    assert "#0072b2" in (folder / "plots" / "errors.svg").read_text()


def test_without_ground_truth_nothing_is_called_an_error(fake_run: Write) -> None:
    page = _page(fake_run(seconds=10.0, has_truth=False))

    assert "Differences from fused" in page.text
    assert "Differences over time" in page.text
    assert "differences from fused, not errors" in page.text
    assert not re.search(r"\b(ATE|RPE|NEES)\b|Errors? (over|against)", page.text)


def test_a_run_that_was_cut_off_still_gets_a_page(fake_run: Write) -> None:
    folder = fake_run(
        seconds=10.0, has_truth=False, has_estimates=False, has_timing=False, has_run_json=False, localizers=("floor",)
    )
    (folder / "config.yaml").unlink()
    (folder / "trajectories" / "fused.tum").write_text("0.0 1.0\n")

    page = _page(folder)

    assert {path.name for path in (folder / "plots").iterdir()} == {"trajectories.svg"}
    assert "No run.json: the run was cut off" in page.text
    assert "fused.tum:1: expected 8 numbers" in page.text
    assert "Counters" not in page.text


def test_a_run_without_a_single_pose_still_gets_a_page(fake_run: Write) -> None:
    folder = fake_run(seconds=10.0, status="running")
    for tum in (folder / "trajectories").iterdir():
        tum.unlink()

    page = _page(folder)

    assert "Cut off while it ran" in page.text
    assert "The run left no trajectory." in page.text
    assert "Estimates over time" in page.text


def test_empty_trajectories_are_told_and_not_drawn(fake_run: Write) -> None:
    folder = fake_run(seconds=10.0)
    (folder / "trajectories" / "klt.tum").write_text("")

    page = _page(folder)

    assert "klt: the estimate has no poses; at least 2 are needed." in page.text
    drawn = (folder / "plots" / "trajectories.svg").read_text()
    assert "klt" not in drawn


def test_static_runs_and_corridors_are_drawn(fake_run: Write) -> None:
    for shape in ("static", "corridor"):
        page = _page(fake_run(name=shape, shape=shape, seconds=10.0))

        assert page.tags.count("svg") == 4 + EXPLORER


def test_arrays_of_a_calibration_are_not_spelled_out(fake_run: Write) -> None:
    page = _page(fake_run(seconds=10.0))

    assert "array [480, 512] float32" in page.text
    assert "AAAA" not in page.text


def test_long_runs_make_no_long_files(fake_run: Write) -> None:
    folder = fake_run(seconds=400.0)

    write_report(folder)

    assert (folder / "report.html").stat().st_size < 600_000


def test_other_folders_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="is not the folder of a run"):
        write_report(tmp_path)


def test_a_folder_that_cannot_be_written_to_is_an_error(fake_run: Write) -> None:
    folder = fake_run(seconds=5.0)
    (folder / "report.html").mkdir()

    with pytest.raises(DataError, match="cannot write the report into"):
        write_report(folder)


def test_drawing_leaves_the_settings_of_matplotlib_alone(fake_run: Write) -> None:
    import matplotlib as mpl

    before = dict(mpl.rcParams)

    write_report(fake_run(seconds=5.0))

    assert dict(mpl.rcParams) == before


def test_metrics_and_tables_import_nothing_heavy() -> None:
    code = (
        "import sys, trailmark.evaluation, trailmark.report, trailmark.report.console, trailmark.cli.evaluate,"
        " trailmark.cli.compare;"
        "heavy = {'cv2', 'numba', 'sklearn', 'scipy', 'filterpy', 'matplotlib', 'rich', 'ruamel'};"
        "print(sorted(heavy & set(sys.modules)))"
    )

    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)

    assert found.stdout.strip() == "[]"
