"""Figures of experiments: written where they should be, the same bytes each time, with a legend of all labels."""

from __future__ import annotations

import re

import pytest

from trailmark.report.drawing import BLUE, RED, drawing, legend_above


def draw(path, name=None):
    with drawing(path, 3.0, rows=2, name=name) as (figure, (above, below)):
        above.plot([0, 1], [0, 1], color=BLUE, label="ours")
        below.plot([0, 1], [1, 0], color=RED, label="theirs")
        below.set_title("offset [m]")
        legend_above(figure, columns=3)
    return path.read_text(encoding="utf-8")


def test_the_same_content_gives_the_same_bytes(tmp_path):
    assert draw(tmp_path / "a" / "figure.svg") == draw(tmp_path / "b" / "figure.svg")


def test_ids_are_of_the_name_so_that_two_drawings_can_stand_in_one_page(tmp_path):
    ids = {name: set(re.findall(r'id="([^"]+)"', draw(tmp_path / "figure.svg", name))) for name in ("one", "two")}

    assert ids["one"]
    assert not ids["one"] & ids["two"]


def test_text_stays_text_and_every_label_is_in_the_legend(tmp_path):
    svg = draw(tmp_path / "figure.svg")

    for word in ("ours", "theirs", "offset [m]"):
        assert word in re.sub("<[^>]*>", "", svg)
    assert BLUE in svg
    assert RED in svg


def test_without_labels_there_is_no_legend(tmp_path):
    with drawing(tmp_path / "figure.svg", 2.0) as (figure, axes):
        axes.plot([0, 1], [0, 1])
        legend_above(figure, columns=3)

    assert not figure.legends


def test_a_figure_that_cannot_be_drawn_leaves_no_file(tmp_path):
    with pytest.raises(ZeroDivisionError), drawing(tmp_path / "figure.svg", 2.0) as (_, axes):
        axes.plot([0, 1], [0, 1 / 0])

    assert not (tmp_path / "figure.svg").exists()
