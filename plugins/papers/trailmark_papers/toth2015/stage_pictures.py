"""The paper's Figures 5 to 10: the stages of one picture."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from trailmark.experiments import ExperimentOptions
from trailmark.report.drawing import drawing
from trailmark_papers.kit.jpegs import with_jpegs
from trailmark_papers.toth2015.drives import LANDMARKS, Plan, drive

__all__ = ["draw_stages"]

_SIZE = 320, 240


def draw_stages(options: ExperimentOptions) -> None:
    """Draw the six stages of a picture of the laboratory."""
    import cv2

    with tempfile.TemporaryDirectory() as folder:
        method = {**LANDMARKS, "debug_images": folder}
        drive(
            Plan(
                "stages",
                "lab",
                options.seed,
                {"landmarks": method},
                {"registered": False},
                length_m=0.15,
                world_seed=options.world_seed,
            )
        )
        pictures = sorted(Path(folder).glob("000002_*.png"))
        drawn = options.out / "stages.svg"
        with drawing(drawn, 7.4, rows=3, columns=2) as (figure, _):
            for axes, path, number in zip(figure.axes, pictures, range(5, 11)):
                whole = np.asarray(cv2.imread(str(path)), np.uint8)
                axes.imshow(cv2.resize(whole, _SIZE, interpolation=cv2.INTER_AREA)[..., ::-1])
                axes.set_axis_off()
                axes.set_title(f"Figure {number}: {path.stem[9:].replace('_', ' ')}")
        drawn.write_text(with_jpegs(drawn.read_text(encoding="utf-8")), encoding="utf-8")
