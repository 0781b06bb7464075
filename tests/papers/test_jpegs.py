"""Photographs in drawings."""

from __future__ import annotations

import base64
import re

import cv2
import numpy as np
import pytest

from trailmark.report.drawing import drawing
from trailmark_papers.kit.jpegs import with_jpegs


def _pictures(svg):
    found = re.findall(r'data:image/(\w+);base64,([^"]*)', svg)
    return [
        (kind, cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), cv2.IMREAD_UNCHANGED))
        for kind, data in found
    ]


def test_pictures_in_a_figure_become_small_and_look_the_same(tmp_path):
    rng = np.random.default_rng(3)
    scene = cv2.GaussianBlur(rng.integers(0, 256, (240, 320, 3), np.uint8), (0, 0), 3.0)
    scene = cv2.normalize(scene, None, 0, 255, cv2.NORM_MINMAX)
    with drawing(tmp_path / "a.svg", 2.6) as (_, axes):
        axes.imshow(scene)
    svg = (tmp_path / "a.svg").read_text("utf-8")

    small = with_jpegs(svg)

    ((before, was),) = _pictures(svg)
    ((after, now),) = _pictures(small)
    assert (before, after) == ("png", "jpeg")
    assert len(small) < 0.5 * len(svg)
    assert cv2.PSNR(np.ascontiguousarray(was[..., :3]), now) > 32.0
    assert re.sub(r"data:[^\"]*", "", small) == re.sub(r"data:[^\"]*", "", svg)


def test_a_transparent_picture_is_refused():
    png = cv2.imencode(".png", np.zeros((4, 4, 4), np.uint8))[1].tobytes()

    with pytest.raises(ValueError, match="transparent"):
        with_jpegs(f'<image xlink:href="data:image/png;base64,{base64.b64encode(png).decode()}"/>')
