"""Registering the ground while a path is taught, and correcting the pose with it afterwards."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Floats, Grey8, Int64s
from trailmark.errors import ConfigError, StoreError
from trailmark.estimates import Belief, Estimate, Fix, Lost
from trailmark.frames import Frame, SensorInfo
from trailmark.geometry import Pose2
from trailmark.interfaces import Localizer, LocalizerMap, Session
from trailmark.isolation.compiling import compile_together
from trailmark.paths import Keyframe
from trailmark_ground_vo.config import GroundMapConfig
from trailmark_ground_vo.covers import covered_pixels
from trailmark_ground_vo.fixed_pixels import fixed_pixels
from trailmark_ground_vo.levels import LEFT_OUT
from trailmark_ground_vo.motion import ImageMotion, ground_information, pose_prev_now
from trailmark_ground_vo.patch import PatchFinder, PatchMatch, PatchView
from trailmark_ground_vo.picture import PictureReader, camera_of, ground_plane
from trailmark_ground_vo.start_search import Guess, GuessVerdict, StartSearch
from trailmark_ground_vo.systematic import nod_covariance
from trailmark_ground_vo.uncertainty import turn_information, with_scatter

__all__ = ["GroundMap"]

#: Duration of a search on one core of 2024, kernel and refinement [s].
_LATENCY_S = {"exhaustive": 5e-3, "pyramid": 1e-3}

#: What sums of steps may be off [m].
_ROUNDING_M = 1e-9

#: Patches that a picture is asked for at most when a guess is judged; the paper's picture shows two or three.
_MOST_IN_VIEW = 3

#: Standard deviation of a heading that is not told: as much as the search covers, so that nobody is led by it [rad].
_UNTOLD_RAD = math.radians(5.0)

_SETTINGS = "settings"


@dataclass(frozen=True, slots=True, eq=False)
class _Places:
    """What was registered: patches and the poses of the camera and of base."""

    patches: list[Grey8]
    cameras: list[Pose2]
    positions: Floats


class GroundMap(Localizer):
    """Remembers patches of the ground and finds them again (Nagai & Watanabe 2015, Sec. II-B).

    In teach it registers a patch every 0.05 m. Afterwards it searches for a patch as soon as its place is believed to
    be within 0.025 m, until it is found or given up for this pass, and answers a `Fix`, or `Lost` when the groups do
    not agree. While the pose is unknown it looks for all patches, some in each picture.
    """

    config: GroundMapConfig

    def __init__(self, config: GroundMapConfig) -> None:
        super().__init__(config)
        self._sensor: SensorInfo
        self._reader: PictureReader
        self._localizer_map: LocalizerMap
        self._finder: PatchFinder | None = None
        self._places: _Places | None = None
        self._next_m = 0.0

    def start(self, session: Session) -> None:
        """Load what was registered and compile the kernels.

        Raises
        ------
        ConfigError
            If there is no path store, or the camera has no scale.
        StoreError
            If what is stored is not what this config registers.
        """
        if session.map is None:
            raise ConfigError(
                f"localizer {session.name!r}: ground_map registers patches and searches for them, but there is no"
                " path store; use `trailmark teach` or `replay`, or `run` with --store"
            )
        self._localizer_map = session.map
        self._sensor = camera_of(session, self.config.camera)
        self._reader = PictureReader(self._sensor)
        self._scale = ground_plane(self._sensor).metres_per_pixel
        self._mounting = self._sensor.pose_base_sensor.planar()
        self._mounting_inverse = self._mounting.inverse()
        self._next_m = 0.0
        self._tried, self._attempts = -1, 0
        self._start_search: StartSearch | None = None
        self._searches = 0
        self._counts = {"registered": 0, "searched": 0, "found": 0, "rejected": 0}
        self._finder = None
        self._places = None if session.mode == "teach" else self._load()
        if session.mode == "teach":
            self._localizer_map.save(_SETTINGS, self._settings())
        self._warm_up(self._sensor.size or (512, 480))

    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        """Register the ground, or search for a patch that ought to be seen."""
        if frame.sensor != self._sensor.name:
            return ()
        self._searches = 0
        if self._places is None:
            self._teach(frame, belief)
            return ()
        if not self._places.patches:
            return ()
        if belief.pose_map_base is None:
            return self._look_everywhere(frame, belief)
        self._start_search = None
        return self._look_nearby(frame, belief.pose_map_base)

    def latency_s(self) -> float:
        """Return how long the last call takes: its searches, each of the usual duration."""
        return self._searches * _LATENCY_S[self.config.search]

    def counters(self) -> Mapping[str, int]:
        """Return what was registered, searched, found and rejected."""
        return dict(self._counts)

    def _teach(self, frame: Frame, belief: Belief) -> None:
        if belief.pose_map_base is None or belief.travelled_m < self._next_m - _ROUNDING_M:
            return
        view = self._view(frame)
        patch = self._the_finder().register(view)
        self._localizer_map.add(Keyframe(belief.travelled_m, frame.stamp_s, belief.pose_map_base, {"patch": patch}))
        # the next place lies on the grid of the way, so that overshooting by a picture does not add up
        passed = math.floor((belief.travelled_m + _ROUNDING_M) / self.config.spacing_m)
        self._next_m = (passed + 1) * self.config.spacing_m
        self._counts["registered"] += 1

    def _look_nearby(self, frame: Frame, pose_map_base: Pose2) -> Sequence[Estimate]:
        """Search for the nearest patch that is in reach and has not been dealt with on this pass."""
        assert self._places is not None
        camera = pose_map_base @ self._mounting
        nearest = self._nearest(pose_map_base, camera)
        if nearest != self._tried:
            self._tried, self._attempts = nearest, 0
        if nearest < 0 or self._attempts >= self.config.max_attempts:
            return ()
        self._attempts += 1
        found = self._find(self._view(frame), nearest, camera)
        if found.reason:
            self._counts["rejected"] += 1
            return (Lost(frame.stamp_s, found.reason, {"place": float(nearest), **found.details}),)
        self._attempts = self.config.max_attempts  # done, until another patch is nearer
        self._counts["found"] += 1
        return (self._fix(frame.stamp_s, nearest, found),)

    def _nearest(self, pose_map_base: Pose2, camera: Pose2) -> int:
        """Return the nearest place within reach whose heading the search covers, or -1."""
        assert self._places is not None
        offsets = self._places.positions - (pose_map_base.x, pose_map_base.y)
        distances = np.hypot(offsets[:, 0], offsets[:, 1])
        near = np.flatnonzero(distances <= self.config.reach_m)
        finder = self._the_finder()
        usable = [n for n in near if finder.is_in_reach(self._motion_since_patch(int(n), camera))]
        return int(min(usable, key=lambda n: float(distances[n]))) if usable else -1

    def _look_everywhere(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        """Try some of the places where they were registered; with all tried, believe the one that stands out."""
        assert self._places is not None
        search, view = self._the_start_search(), self._view(frame)
        for place in search.next_places(self.config.global_batch):
            found = self._find(view, place, self._places.cameras[place])
            if self._the_finder().fits(found):
                pose = self._fix(frame.stamp_s, place, found).pose_map_base
                search.add(pose, belief.pose_odom_base, belief.travelled_m)
        if not search.is_through:
            return (Lost(frame.stamp_s, f"start unknown: tried {search.n_tried} of {search.n_places} places"),)
        answers = [self._judge_guess(frame.stamp_s, view, guess, belief.pose_odom_base) for guess in search.guesses]
        n_guesses = len(search.guesses)
        chosen = search.judge([verdict for verdict, _ in answers], belief.travelled_m)
        for verdict, fix in answers:
            if verdict.guess is chosen and fix is not None:
                self._counts["found"] += 1
                return (fix,)
        if not n_guesses:
            return (Lost(frame.stamp_s, f"start unknown: none of {search.n_places} places looks like this"),)
        reason = f"start unknown: {n_guesses} of {search.n_places} places may be this one; drive on, or tell the start"
        return (Lost(frame.stamp_s, reason, {"guesses": float(n_guesses)}),)

    def _judge_guess(
        self, stamp_s: float, view: PatchView, guess: Guess, pose_odom_base: Pose2
    ) -> tuple[GuessVerdict, Fix | None]:
        """Search all patches that the picture shows if a guess is right; with it, the fix by the nearest one."""
        pose = guess.pose_map_odom @ pose_odom_base
        camera = pose @ self._mounting
        seen, misfits, fix = self._in_view(pose, camera), [], None
        for place in seen:
            found = self._find(view, place, camera)
            is_there = self._the_finder().confirms(found)
            misfits.append(1.0 - found.correlation**2 if is_there else 1.0)
            if is_there and fix is None:
                fix = self._fix(stamp_s, place, found)
        n_found = sum(misfit < 1.0 for misfit in misfits)
        return GuessVerdict(guess, len(seen), n_found, float(np.mean(misfits)) if misfits else 1.0), fix

    def _in_view(self, pose_map_base: Pose2, camera: Pose2) -> list[int]:
        """Return the places whose patches the picture shows whole, the nearest first."""
        assert self._places is not None
        finder, offsets = self._the_finder(), self._places.positions - (pose_map_base.x, pose_map_base.y)
        nearest_first = np.argsort(np.hypot(offsets[:, 0], offsets[:, 1]), kind="stable")[:_MOST_IN_VIEW]
        return [int(n) for n in nearest_first if finder.is_in_view(self._motion_since_patch(int(n), camera))]

    def _the_start_search(self) -> StartSearch:
        assert self._places is not None
        if self._start_search is None:
            config, n_places = self.config, len(self._places.patches)
            shows_two = self._the_finder().view_px * min(self._scale) >= config.spacing_m
            self._start_search = StartSearch(
                n_places,
                config.start_margin,
                config.max_attempts,
                min(2 if shows_two else 1, n_places),
                config.confirm_m,
            )
        return self._start_search

    def _find(self, view: PatchView, place: int, camera: Pose2) -> PatchMatch:
        assert self._places is not None
        self._searches += 1
        self._counts["searched"] += 1
        return self._the_finder().find(view, self._places.patches[place], self._motion_since_patch(place, camera))

    def _motion_since_patch(self, place: int, camera: Pose2) -> ImageMotion:
        """Return how the content has moved since a patch was registered, were the camera there."""
        assert self._places is not None
        content = camera.between(self._places.cameras[place])
        return ImageMotion(content.x / self._scale[0], -content.y / self._scale[1], content.theta)

    def _fix(self, stamp_s: float, place: int, found: PatchMatch) -> Fix:
        assert self._places is not None
        motion = pose_prev_now(found.motion, self._scale)
        pose = self._places.cameras[place] @ motion @ self._mounting_inverse
        aspect = self._scale[1] / self._scale[0]
        nods = nod_covariance(math.radians(self.config.tilt_deg), self._width_px, aspect)
        widened = with_scatter(found.information, 2.0 * nods)  # then and now
        if turn_information(widened) < 1.0 / math.radians(self.config.heading_sigma_deg) ** 2:
            widened = with_scatter(widened, np.diag([0.0, 0.0, _UNTOLD_RAD**2]))
        information = ground_information(widened, motion, self._scale, self._mounting)
        # of the motion of base since the patch was registered, in the axes of base then: turn to those of the map
        heading = self._places.cameras[place].theta - self._mounting.theta
        turn = Pose2(0.0, 0.0, heading).matrix()
        return Fix(stamp_s, pose, turn @ information @ turn.T, {"place": float(place), **found.details})

    def _view(self, frame: Frame) -> PatchView:
        image = self._reader.read(frame)
        if self._finder is None:
            self._finder = self._new_finder((image.shape[1], image.shape[0]))
        return self._finder.view(image)

    def _the_finder(self) -> PatchFinder:
        assert self._finder is not None
        return self._finder

    def _new_finder(self, size: tuple[int, int]) -> PatchFinder:
        self._width_px = size[0]
        return PatchFinder(self.config, size, self._scale[1] / self._scale[0])

    def _warm_up(self, size: tuple[int, int]) -> None:
        compile_together("trailmark_ground_vo.first_kernels.FIRST_KERNELS")
        self._reader.warm_up()
        self._finder = self._new_finder(size)
        view = self._finder.view(np.random.default_rng(0).integers(0, 256, (size[1], size[0]), np.uint8))
        self._finder.find(view, self._finder.register(view), ImageMotion(0.0, 0.0, 0.0))
        if self._sensor.size is None:
            self._finder = None

    def _settings(self) -> dict[str, Int64s]:
        return {"high_pass": np.array([int(self.config.high_pass)]), "patch_px": np.array([self.config.patch_px])}

    def _load(self) -> _Places:
        stored = self._localizer_map.load(_SETTINGS)
        for name, value in self._settings().items() if stored is not None else ():
            taught = stored[name] if stored is not None and name in stored else None
            if taught is None or not np.array_equal(taught, value):
                raise StoreError(
                    f"the patches of localizer 'ground_map' were taught with {name} = {taught}, but the config has"
                    f" {value}; set it as taught, or teach anew"
                )
        keyframes = self._localizer_map.keyframes()
        patches = [self._patch(keyframe) for keyframe in keyframes]
        cameras = [keyframe.pose_map_base @ self._mounting for keyframe in keyframes]
        if self.config.high_pass and patches:
            stack = np.stack(patches)
            stack[fixed_pixels(stack)] = LEFT_OUT
            half_size_m = 2.0 * math.sqrt(self._scale[0] * self._scale[1])
            stack[covered_pixels(stack, np.array([[one.x, one.y] for one in cameras]) / half_size_m)] = LEFT_OUT
            patches = list(stack)
        positions = np.array([[k.pose_map_base.x, k.pose_map_base.y] for k in keyframes]).reshape(-1, 2)
        return _Places(patches, cameras, positions)

    def _patch(self, keyframe: Keyframe) -> Grey8:
        patch, side = keyframe.arrays.get("patch"), self.config.patch_px
        if patch is None or patch.shape != (side, side) or patch.dtype != np.uint8:
            found = "no patch" if patch is None else f"a patch of {patch.shape} {patch.dtype}"
            raise StoreError(
                f"the keyframe of ground_map at {keyframe.station_m:.3f} m holds {found} instead of"
                f" ({side}, {side}) uint8; teach anew"
            )
        return np.array(patch, np.uint8, order="C")
