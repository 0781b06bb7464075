"""Tiles of the ground that one camera leaves to the next."""

from __future__ import annotations

import gc
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from trailmark.geometry import Pose2
from trailmark_sim.ground import tiles
from trailmark_sim.ground.camera import GroundCameraSensor, GroundRig
from trailmark_sim.ground.ground import Floor, GroundTexture, Zone
from trailmark_sim.ground.optics import Optics
from trailmark_sim.vehicles import VehicleState

RIG = GroundRig(width=160, height=120, field_m=(160 * 0.2 / 512, 120 * 0.188 / 480))
HERE = VehicleState(Pose2(0.3, 0.1, 0.2))


def see_floor(floor: Floor, seed: int = 1, optics: Optics | None = None) -> tuple[int, np.ndarray]:
    """Return how many tiles a camera painted that is gone afterwards, and its picture."""
    camera = GroundCameraSensor("floor", GroundTexture([Zone(floor)], seed), RIG, optics or Optics(), seed=7)
    picture = camera.render(0, 0.0, HERE).pixels
    painted = camera.tiles.n_painted
    del camera
    gc.collect()
    return painted, picture


@pytest.mark.usefixtures("lends_tiles")
class TestLending:
    def test_the_next_camera_over_the_same_ground_paints_nothing_and_sees_the_same(self) -> None:
        painted, first = see_floor(Floor("wood"))

        painted_again, second = see_floor(Floor("wood"))

        assert painted > 0
        assert painted_again == 0
        np.testing.assert_array_equal(second, first)

    @pytest.mark.parametrize(
        "other", [{"floor": Floor("soil")}, {"seed": 2}, {"optics": replace(Optics(), psf_px=1.0)}]
    )
    def test_another_floor_seed_or_lens_is_painted_anew(self, other: dict) -> None:
        see_floor(Floor("wood"))

        painted, _ = see_floor(**{"floor": Floor("wood")} | other)

        assert painted > 0

    def test_two_cameras_at_once_have_tiles_of_their_own(self) -> None:
        first, second = (
            GroundCameraSensor("floor", GroundTexture([Zone(Floor("wood"))], 1), RIG, Optics(), seed=7) for _ in "ab"
        )

        assert first.tiles is not second.tiles

    def test_only_the_last_camera_leaves_its_tiles(self) -> None:
        see_floor(Floor("wood"))
        see_floor(Floor("soil"))

        assert len(tiles._spare) == 1

    def test_a_photograph_may_have_changed_and_is_painted_anew(self, tmp_path: Path) -> None:
        photo = tmp_path / "floor.png"
        cv2.imwrite(str(photo), np.random.default_rng(7).integers(0, 255, (300, 300), np.uint8))
        see_floor(Floor(photo=photo))

        painted, _ = see_floor(Floor(photo=photo))

        assert painted > 0
