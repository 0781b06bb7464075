"""Particles, the field of a grid and the kernels, each against numbers that are known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import chi2

from trailmark.geometry import Pose2
from trailmark_laser_maps.grid import OccupancyGrid
from trailmark_laser_maps.mcl.field import GridField
from trailmark_laser_maps.mcl.filter import FilterSettings, GridFilter, Placed, Unplaced
from trailmark_laser_maps.mcl.hypotheses import RankedPlaces, best_of_each_neighbourhood, moved_by
from trailmark_laser_maps.mcl.kernels import explained_shares, refine_poses, score_poses
from trailmark_laser_maps.mcl.particles import MotionNoise, Particles, kld_count


@pytest.fixture(scope="module")
def field() -> GridField:
    """A wall at x = 2.0 to 2.1 m and one at y = 1.0 to 1.1 m, in 4 x 4 m of free floor."""
    cells = np.zeros((40, 40), np.int8)
    cells[:, 20] = cells[10, :20] = 100
    return GridField.of(OccupancyGrid(cells, 0.1))


def test_the_field_is_the_distance_to_the_nearest_wall(field: GridField) -> None:
    assert field.distance_m[30, 20] == 0.0
    assert field.distance_m[30, 15] == pytest.approx(0.5)
    assert field.distance_m[15, 3] == pytest.approx(0.5)
    assert field.distance_m[39, 39] == pytest.approx(1.0)  # beyond reach all is alike
    wall = field.nearest_idx[30, 15]
    np.testing.assert_allclose(field.walls[wall], [2.05, 3.05], atol=1e-9)
    np.testing.assert_allclose(np.abs(field.normals[wall]), [1.0, 0.0], atol=1e-9)
    assert field.narrow.max() == pytest.approx(0.0, abs=1e-6)
    assert field.narrow.min() == pytest.approx(math.log(0.1), abs=1e-6)


def test_poses_are_drawn_all_over_the_free_cells(field: GridField) -> None:
    poses = field.draw_poses(20_000, np.random.default_rng(7))
    columns, rows = (poses[:, :2] / field.cell_m).astype(int).T
    assert field.is_free[rows, columns].all()
    assert abs(poses[:, 0].mean() - 2.0) < 0.05
    assert abs(np.exp(1j * poses[:, 2]).mean()) < 0.02


def test_a_score_is_the_sum_of_what_the_table_says(field: GridField) -> None:
    poses = np.array([[1.0, 3.05, 0.0], [1.0, 3.05, math.pi], [0.5, 3.05, 0.0]])
    rays = np.array([[1.05, 0.0], [0.0, 0.5]])
    scores = score_poses(poses, rays, field.narrow, field.is_free, field.cell_m, -9.0)
    open_floor = float(field.narrow[35, 10])
    assert scores[0] == pytest.approx(0.0 + open_floor, abs=1e-5)
    assert scores[1] == pytest.approx(-9.0 + float(field.narrow[25, 10]), abs=1e-5)  # the ray leaves the map
    assert scores[2] < scores[0]
    on_a_wall = score_poses(np.array([[2.05, 3.05, 0.0]]), rays[1:], field.narrow, field.is_free, field.cell_m, -9.0)
    assert on_a_wall[0] == pytest.approx(0.0 - 0.2 * 9.0, abs=1e-5)


def test_a_ray_through_a_wall_is_not_explained(field: GridField) -> None:
    rays = np.array([[1.05, 0.0], [-1.0, 0.0], [1.0, 0.3]])
    laser = np.zeros(2)
    here = np.array([[1.0, 3.05, 0.0]])
    shares = explained_shares(here, rays, laser, field.distance_m, field.cell_m, 0.15)
    assert shares[0] == pytest.approx(2 / 3)
    through = np.array([[0.0, -2.5]])  # ends by the wall at x = 2 as seen from below, through the one at y = 1
    pose = np.array([[1.95, 3.0, 0.0]])
    assert explained_shares(pose, through, laser, field.distance_m, field.cell_m, 0.15)[0] == 0.0


def test_refined_poses_stand_where_the_walls_are_met(field: GridField) -> None:
    truth = Pose2(0.8, 2.0, 0.1)
    wall_x = np.array([(2.05, y) for y in np.linspace(1.5, 3.5, 40)])
    wall_y = np.array([(x, 1.05) for x in np.linspace(0.2, 1.8, 40)])
    rays = truth.inverse() @ np.vstack([wall_x, wall_y])
    starts = truth.array() + np.array([[0.2, -0.15, 0.1], [-0.1, 0.1, -0.08]])
    gates = np.array([0.6, 0.5, 0.4, 0.3, 0.3, 0.3])
    found = refine_poses(starts, rays, field.walls, field.normals, field.nearest_idx, field.cell_m, gates)
    np.testing.assert_allclose(found, np.broadcast_to(truth.array(), (2, 3)), atol=2e-3)


def test_a_corridor_leaves_the_way_along_it_alone(field: GridField) -> None:
    rays = Pose2(0.8, 2.0, 0.0).inverse() @ np.array([(x, 1.05) for x in np.linspace(0.2, 1.4, 40)])
    start = np.array([[0.7, 2.1, 0.05]])
    found = refine_poses(start, rays, field.walls, field.normals, field.nearest_idx, field.cell_m, np.full(6, 0.4))
    assert found[0, 0] == pytest.approx(0.7, abs=0.02)
    assert found[0, 1] == pytest.approx(2.0, abs=2e-3)
    assert found[0, 2] == pytest.approx(0.0, abs=2e-3)


def test_motion_spreads_as_its_noise_says() -> None:
    rng = np.random.default_rng(7)
    noise = MotionNoise(along=0.1, across=0.02, turn_per_m=0.05, turn_per_rad=0.0, rest_m=0.0, rest_rad=0.0)
    particles = Particles.even(np.tile([1.0, 2.0, math.pi / 2], (40_000, 1)))
    moved = particles.moved(Pose2(2.0, 0.0, 0.3), noise, rng).poses
    np.testing.assert_allclose(moved.mean(axis=0), [1.0, 4.0, math.pi / 2 + 0.3], atol=5e-3)
    np.testing.assert_allclose(moved.std(axis=0), [0.04, 0.2, 0.1], rtol=0.02)


def test_without_noise_particles_move_as_poses_do() -> None:
    still = MotionNoise(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    start, step = Pose2(1.0, -2.0, 0.7), Pose2(0.3, 0.1, -0.2)
    moved = Particles.even(start.array()[np.newaxis]).moved(step, still, np.random.default_rng(0)).poses
    np.testing.assert_allclose(moved[0], (start @ step).array(), atol=1e-12)
    np.testing.assert_allclose(moved_by(start.array()[np.newaxis], step), moved, atol=1e-12)


@pytest.mark.parametrize("n_bins", [2, 10, 100, 1000])
def test_the_count_is_the_quantile_of_chi_squared(n_bins: int) -> None:
    exact = chi2.ppf(0.99, n_bins - 1) / (2 * 0.05)
    assert kld_count(n_bins) == pytest.approx(exact, rel=0.03)
    assert kld_count(1) == 1


def test_few_are_drawn_where_all_are_together_and_many_where_they_are_not() -> None:
    rng = np.random.default_rng(7)
    together = Particles.around(np.zeros(3), np.diag([1e-3, 1e-3, 1e-3]), 5000, rng).resampled(300, 10_000, rng)
    apart = Particles.even(rng.uniform(-10, 10, (5000, 3))).resampled(300, 10_000, rng)
    assert len(together) == 300
    assert len(apart) == 10_000


def test_drawing_anew_keeps_shares() -> None:
    rng = np.random.default_rng(7)
    poses = np.repeat([[0.0, 0.0, 0.0], [5.0, 0.0, 0.0]], 500, axis=0)
    weighed = Particles.even(poses).weighed(np.repeat([math.log(3.0), 0.0], 500))
    drawn = weighed.resampled(1000, 1000, rng)
    assert (drawn.poses[:, 0] == 0.0).mean() == pytest.approx(0.75, abs=0.002)
    assert weighed.effective_count == pytest.approx(1000 / 1.25)


def test_two_places_are_two_clusters_and_the_seam_of_headings_is_none() -> None:
    rng = np.random.default_rng(7)
    small = np.diag([0.01, 0.01, 0.01])
    one = Particles.around(np.array([1.0, 1.0, math.pi]), small, 700, rng).poses
    two = Particles.around(np.array([4.0, 1.0, 0.0]), small, 300, rng).poses
    first, second, *rest = Particles.even(np.vstack([one, two])).clusters()
    assert sum(cluster.share for cluster in rest) < 0.01
    assert first.share == pytest.approx(0.7, abs=0.02)
    np.testing.assert_allclose(second.mean, [4.0, 1.0, 0.0], atol=0.03)
    assert abs(math.remainder(float(first.mean[2]) - math.pi, 2 * math.pi)) < 0.02
    np.testing.assert_allclose(first.covariance, small, atol=2e-3)


def test_one_of_each_neighbourhood_is_kept_the_best() -> None:
    poses = np.array([[0.1, 0.1, 0.1], [0.2, 0.1, 0.1], [3.0, 0.1, 0.1], [0.1, 0.1, 2.0]])
    kept = best_of_each_neighbourhood(poses, np.array([1.0, 5.0, 2.0, 3.0]), 3)
    np.testing.assert_array_equal(kept, poses[[1, 3, 2]])


def test_a_place_that_wins_one_look_only_is_not_believed(field: GridField) -> None:
    filter_ = GridFilter(field, FilterSettings(), np.random.default_rng(7))
    here, there = (RankedPlaces(np.array([[x, 2.0, 0.0]]), np.array([0.9]), 5) for x in (0.5, 1.5))
    assert [type(filter_._decide(places)) for places in (here, there, here)] == [Unplaced] * 3
    none = RankedPlaces(here.poses, np.array([0.3]), 5)
    said = [type(filter_._decide(places)) for places in (here, none, here, here)]
    assert said == [Placed, Unplaced, Unplaced, Placed]


@pytest.mark.parametrize("good_every", [1000, 5, 3])
def test_a_fall_of_the_fit_that_lasts_becomes_usual_whatever_single_looks_say(
    field: GridField, good_every: int
) -> None:
    filter_ = GridFilter(field, FilterSettings(patience=5), np.random.default_rng(7))
    for _ in range(20):
        assert not filter_._has_fallen(0.95)

    falls = [filter_._has_fallen(0.95 if look % good_every == good_every - 1 else 0.75) for look in range(40)]

    assert falls[0]
    assert not any(falls[25:])


def test_a_fall_of_the_fit_now_and_then_stays_a_fall(field: GridField) -> None:
    filter_ = GridFilter(field, FilterSettings(patience=5), np.random.default_rng(7))
    for _ in range(20):
        filter_._has_fallen(0.95)

    falls = [filter_._has_fallen(0.75 if look % 3 == 2 else 0.95) for look in range(60)]

    assert falls[2::3] == [True] * 20
    assert sum(falls) == 20


def test_only_a_fall_from_one_look_to_the_next_may_be_of_who_was_carried_away(field: GridField) -> None:
    filter_ = GridFilter(field, FilterSettings(), np.random.default_rng(7))
    for quality in [0.97] * 20 + [0.95, 0.93, 0.91]:
        assert not filter_._has_fallen(quality)
    assert filter_._has_fallen(0.88)
    assert not filter_._fell_at_once  # people come into sight bit by bit
    assert filter_._has_fallen(0.80)
    assert filter_._fell_at_once
    assert filter_._has_fallen(0.80)
    assert filter_._fell_at_once  # until it explains as much as before
    for _ in range(4):
        filter_._has_fallen(0.97)
    assert not filter_._fell_at_once
