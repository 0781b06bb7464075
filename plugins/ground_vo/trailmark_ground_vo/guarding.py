"""Two trackers of one camera: a plain one for light that stays, and a guarded one that decides where it does not.

The plain one is exact and quick, and believes what it sees. Every motion that it tells is audited. As soon as the audit
finds something, the guarded one takes over, from the last picture that was beyond suspicion, and keeps the track until
the audit has found nothing for a while.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from trailmark.arrays import Float32s, Floats, Grey8, Grey16
from trailmark_ground_vo import reasons
from trailmark_ground_vo.audit import MotionAudit
from trailmark_ground_vo.closed_places import closed_by
from trailmark_ground_vo.config import GroundVOConfig
from trailmark_ground_vo.filters import noise_level
from trailmark_ground_vo.grain import AlongGrain, Grain
from trailmark_ground_vo.kernels import load_kernels
from trailmark_ground_vo.lens_marks import LensMarkEvidence
from trailmark_ground_vo.motion import ImageMotion
from trailmark_ground_vo.moving_layer import LayerWatch
from trailmark_ground_vo.repeats import RepeatWatch
from trailmark_ground_vo.rest import RestWatch
from trailmark_ground_vo.rivals import RivalSearch, stands_still
from trailmark_ground_vo.shared_texture import TextureComparison
from trailmark_ground_vo.sudden_rest import SuddenRest
from trailmark_ground_vo.tracker import RelativeTracker, TrackedMotion, TrackingFailure
from trailmark_ground_vo.viewpoint import SearchPicture
from trailmark_ground_vo.weak_axis import WeakAxis

__all__ = ["GroundTracker"]

logger = logging.getLogger(__name__)

#: Pictures without a finding after which the plain tracker has its way again, at first and at most: twice as many
#: each time that it fails soon.
_CALM_FRAMES, _MOST_CALM_FRAMES = 30, 960

#: Spread of the differences of two smoothed pictures of the same, over the noise before: by the filter, at most in
#: light that is modelled, and the most that is believed; content that does not move so shows 1.4 and more.
_SPREAD_OVER_NOISE, _USUAL_SPREAD, _MOST_SPREAD = 0.39, 0.6, 0.9

#: Or of what a wrong motion leaves, so far from it [px].
_MOST_OF_ELSEWHERE, _ELSEWHERE_PX = 0.9, 17.0

#: Beside marks that are known a motion tells so much less: their rims pull all motions the same way (8 reflections on
#: dark wood: 16 deg over 550 pictures, 6.7 standard deviations of their sum).
_MARKED = 4.0

#: Pictures that may be doubted in a row before other pixels are chosen.
_PATIENCE_FRAMES = 2

_STILL = ImageMotion(0.0, 0.0, 0.0)

#: Others that expect less move no more than a robot that stands [px].
_RESTING_PX = 0.3
#: What the same picture again says where others stand: that it stands as far as they tell, no more [1/px^2, 1/rad^2].
_NO_MORE = np.diag([1.0 / 0.5**2, 1.0 / 0.5**2, 1.0 / 0.003**2])
#: Least error over that of any place up to which a content that has moved before needs no comparison of its texture.
_SURE_RATIO = 0.5

#: By how much more the texture moves than stands where it is the ground, seen beside marks that are known: a mesh moved
#: by its own period resembles itself as much as at rest.
_GROUND_OVER_FILM = 1.3


class GroundTracker:
    """Follows the ground from picture to picture; in mode refined under two trackers.

    Parameters
    ----------
    config : GroundVOConfig
        Parameters of the paper, and of what was added.
    size : (int, int)
        Width and height of the pictures [px].
    aspect : float
        Metres per pixel along v over those along u.
    """

    def __init__(self, config: GroundVOConfig, size: tuple[int, int], aspect: float = 1.0) -> None:
        self._size = size
        self._plain = RelativeTracker(config, size, aspect)
        self._guarded: RelativeTracker | None = None
        if config.mode == "refined":
            guarded = config.model_copy(update={"learn_flat_field": False})
            self._guarded = RelativeTracker(guarded, size, aspect, is_guarded=True)
        self._active = self._plain
        self._audit = MotionAudit(size, aspect)
        self._smooth = load_kernels(config.use_vectors).smooth
        self._rest = RestWatch()
        self._marks = LensMarkEvidence(size, aspect)
        self._rivals = RivalSearch(self._audit)
        self._weak_axis = WeakAxis(size, aspect)
        self._grain = AlongGrain(size, aspect)
        self._texture = TextureComparison(size, aspect)
        self._ground: Grey16 | None = None  # the last picture of which something was told
        self._n_doubted = 0
        self._sudden_rest = SuddenRest()
        self._understood: tuple[Grey8, Grey16] | None = None
        self._last: ImageMotion | None = None
        self._moved: ImageMotion | None = None  # between the last two pictures, where it is known
        self._repeats = RepeatWatch()
        self._layers = LayerWatch(size)
        self._has_film = False
        self._n_calm = self._calm_frames = _CALM_FRAMES
        self._counts = {"suspected": 0, "guarded": 0, "repeated": 0}

    def warm_up(self) -> None:
        """Compile what pictures will need. The tracker has seen noise then, and is of no more use."""
        width, height = self._size
        noise = np.random.default_rng(0).integers(0, 256, (height, width), np.uint8)
        for stamp_s in range(3):
            noise[0, 0] += 1  # another picture
            self.step(noise.copy(), float(stamp_s))
        self._grain.warm_up()

    def step(
        self, image: Grey8, stamp_s: float, expected: ImageMotion | None = None
    ) -> TrackedMotion | TrackingFailure | None:
        """Compare a picture with what is remembered of the ones before.

        Parameters
        ----------
        image : (H, W) uint8
            The next picture.
        stamp_s : float
            Its stamp, later than the last one's [s].
        expected : ImageMotion, optional
            How the content has moved since the picture of `since_s` if others are right.

        Returns
        -------
        TrackedMotion, TrackingFailure or None
            None for the first picture.
        """
        if self._guarded is None:
            return self._plain.step(image, stamp_s)
        is_repeated = self._repeats.is_same(image)
        if expected is None or math.hypot(expected.u, expected.v) > _RESTING_PX:
            is_encoded_again = not is_repeated and (
                self._repeats.is_due(image) or self._repeats.is_encoded_again(image, self._moved)
            )
            if is_repeated or is_encoded_again:
                # no step: the next picture that is another one is compared with this one, and its motion begins here
                self._repeats.keep(image)
                self._repeats.add_repeat()
                self._counts["repeated"] += 1
                bit_by_bit = reasons.REPEATED if expected is None else reasons.FROZEN
                return TrackingFailure(reasons.ENCODED_AGAIN if is_encoded_again else bit_by_bit, {})
        self._repeats.keep(image)
        before, self._moved = self._understood, None
        said = self._step_plain(image, stamp_s) if self._active is self._plain else self._step_guarded(image, stamp_s)
        if self._active.has_begun_anew:
            self._rest.begin(was_told=self._ground is not None)
        self._repeats.add(said.motion if isinstance(said, TrackedMotion) else None)
        if not isinstance(said, TrackedMotion):
            return said
        self._last = said.motion
        others_rest = expected is not None and math.hypot(expected.u, expected.v) <= _RESTING_PX
        if before is not None and self._is_covered(before, image, said.motion, others_rest=others_rest):
            return TrackingFailure(reasons.COVERED, said.details)
        if self._rest.lacks_evidence and before is not None:
            self._look_for_ground(before[1], said.motion)
        else:
            self._rest.add(said.motion)
        reason = self._rest.reason_doubted(said.motion, expected)
        if reason:
            return TrackingFailure(reason, said.details)
        self._moved, self._ground = said.motion, None if self._understood is None else self._understood[1]
        return replace(said, information=_NO_MORE) if is_repeated else said

    def _is_covered(
        self, before: tuple[Grey8, Grey16], image: Grey8, motion: ImageMotion, *, others_rest: bool
    ) -> bool:
        """Return whether the ground is seen through something sharp; after a finding, until that stands no more."""
        assert self._understood is not None
        if self._layers.is_moving(before[0], image, motion, others_rest=others_rest):
            self._has_film = True
        elif self._has_film and not stands_still(motion):  # what repeats itself, as a mesh does, seems to move
            stands, moves = (self._texture.compare(before[1], self._understood[1], to) for to in (_STILL, motion))
            # ground with coarse grain resembles itself after a small motion, too, but less than where it has gone
            self._has_film = stands.is_there and moves.sigmas < _GROUND_OVER_FILM * stands.sigmas
            return self._has_film
        return self._layers.is_doubtful

    def _look_for_ground(self, before: Grey16, motion: ImageMotion) -> None:
        """Recognise ground by its texture, after a loss by that of the ground before it or by moving."""
        assert self._understood is not None
        now = self._understood[1]
        is_in_focus = self._texture.is_in_focus(before, now, motion)
        self._rest.add(motion, is_in_focus=is_in_focus)
        known = self._ground
        if is_in_focus if known is None else self._texture.compare(known, now, _STILL).is_there:
            self._rest.recognise()

    @property
    def since_s(self) -> float | None:
        """Stamp of the picture that the next one is compared with; None before the first [s]."""
        return self._active.since_s

    def new_flat_field(self) -> Float32s | None:
        """Return the flat field that was learned, (H, W) relative to its mean, when there is a new one."""
        return self._plain.new_flat_field() if self._active is self._plain else None

    def refresh(self, image: Grey8) -> None:
        """Choose all pixels anew, in the picture of the last step with another flat field."""
        self._repeats.keep(image)
        self._plain.refresh(image)
        self._understood = (image, self._smoothed_reference(self._plain))

    def counters(self) -> Mapping[str, int]:
        """Return how often the plain tracker was suspected, and how many pictures the guarded one had."""
        return dict(self._counts)

    def _step_plain(self, image: Grey8, stamp_s: float) -> TrackedMotion | TrackingFailure | None:
        before = self._understood
        since_s, interval_s = self._plain.since_s, self._plain.interval_s
        said = self._plain.step(image, stamp_s)
        if said is None or before is None or since_s is None:
            self._understood = (image, self._smoothed_reference(self._plain))
            return said
        reason = said.reason if isinstance(said, TrackingFailure) else ""
        if isinstance(said, TrackedMotion):
            now = self._smoothed_reference(self._plain)
            reason = self._audit.audit(before[1], now, said.motion).reason_suspected(self._noise(image))
            if not reason and not (self._rest.has_moved and said.details["error_ratio"] <= _SURE_RATIO):
                reason = "" if self._texture.compare(before[1], now, said.motion).is_there else reasons.NO_TEXTURE
            if not reason:
                self._understood, self._n_calm = (image, now), self._n_calm + 1
                return said
        logger.debug("guarded from %.3f s on: %s", since_s, reason)
        self._guard(before[0], since_s, interval_s)
        return self._step_guarded(image, stamp_s)

    def _guard(self, image: Grey8, since_s: float, interval_s: float) -> None:
        """Restart the guarded tracker at the last picture beyond suspicion."""
        assert self._guarded is not None
        self._counts["suspected"] += 1
        was_soon = self._n_calm < self._calm_frames
        self._calm_frames = min(2 * self._calm_frames, _MOST_CALM_FRAMES) if was_soon else _CALM_FRAMES
        self._n_calm = 0
        self._guarded.resume(image, since_s, interval_s, self._last)
        self._active = self._guarded
        if self._last is not None:
            self._sudden_rest.believe(self._last)

    def _step_guarded(self, image: Grey8, stamp_s: float) -> TrackedMotion | TrackingFailure | None:
        guarded = self._guarded
        assert guarded is not None
        self._counts["guarded"] += 1
        reference, previous = guarded.reference, guarded.latest
        said = guarded.step(image, stamp_s)
        if reference is not None and isinstance(said, TrackedMotion) and not self._is_shared(reference, said.motion):
            self._sudden_rest.doubt(None, is_at_rest=False)
            self._learn_what_stands(previous)
            self._ignore_marks()
            guarded.resume(image, stamp_s, 0.0, None)
            self._rest.begin(was_told=self._ground is not None)
            self._understood, self._n_calm = (image, self._smooth(image)), 0
            return TrackingFailure(reasons.NO_TEXTURE, said.details)
        if reference is not None and previous is not None:
            said = self._credible(said, reference, previous)
            is_new = self._ignore_marks()
            if self._n_doubted and (is_new or self._n_doubted > _PATIENCE_FRAMES):  # begin anew after a wrong motion
                self._n_doubted = 0
                guarded.resume(image, stamp_s, 0.0, None)
        now, is_calm = self._smooth(image), False
        if isinstance(said, TrackedMotion):
            if self._understood is not None:
                audit = self._audit.audit(self._understood[1], now, said.motion)
                is_calm = not audit.reason_suspected(self._noise(image))
            self._understood = (image, now)
        elif guarded.has_begun_anew:
            self._understood = (image, now)
        self._n_calm = self._n_calm + 1 if is_calm else 0
        if is_calm and self._n_calm >= self._calm_frames and isinstance(said, TrackedMotion):
            self._plain.resume(image, stamp_s, guarded.interval_s, said.motion)
            self._active, self._n_calm = self._plain, 0
        return said

    def _credible(
        self, said: TrackedMotion | TrackingFailure | None, reference: SearchPicture, previous: SearchPicture
    ) -> TrackedMotion | TrackingFailure | None:
        """Return what was said, or why the picture as a whole, cleaned, does not move so; marks are learned from it."""
        now = self._latest()
        noise = max(1.0, now.noise or 0.0)
        sigma = _SPREAD_OVER_NOISE * noise
        rival, is_at_rest = None, False
        if isinstance(said, TrackedMotion):
            spread = self._spread(reference, now, said.motion)
            if spread > _USUAL_SPREAD * noise or stands_still(said.motion):
                rival = self._better(reference, now, said)
            grain = self._along_grain(reference, now, said) if rival is None and spread < math.inf else None
            rival = grain.rival if grain is not None else rival
            is_explained = rival is None and self._is_explained(reference, now, said.motion, _MOST_SPREAD * noise)
            is_held = self._sudden_rest.is_doubtful(said.motion)
            is_at_rest = is_held and is_explained and spread <= _MOST_SPREAD * noise
            if is_explained and not is_held:
                self._learn_marks(reference, now, said.motion, sigma)
                self._n_doubted = 0
                self._sudden_rest.believe(said.motion)
                # what noise does not explain, light that is not modelled, moves the motion as well
                unexplained = max(1.0, spread / (_USUAL_SPREAD * noise))
                unexplained *= _MARKED if self._marks.are_known else 1.0
                information = self._widened(reference, now, said) / unexplained
                return replace(said, information=information if grain is None else grain.widened(information))
            seen = reasons.differences(spread, noise)
            otherwise = reasons.otherwise(seen, rival, has_grain=grain is not None)
            said = TrackingFailure(reasons.held(seen) if is_explained else otherwise, said.details)
            self._n_doubted += 1
        self._sudden_rest.doubt(rival, is_at_rest=is_at_rest)
        if rival is not None:
            self._learn_marks(reference, now, rival, sigma)
        else:
            self._learn_what_stands(previous)
        return said

    def _is_shared(self, before: SearchPicture, motion: ImageMotion) -> bool:
        """Return whether the last picture, cleaned, shows the texture of the one before where a motion says so."""
        now = self._latest()
        return self._texture.compare(_smoothed(before), _smoothed(now), motion).is_there

    def _is_explained(self, before: SearchPicture, now: SearchPicture, motion: ImageMotion, by_noise: float) -> bool:
        """Return whether noise explains what a motion leaves, or a wrong one elsewhere leaves more."""
        spread = self._spread(before, now, motion)
        elsewhere = replace(motion, u=motion.u + _ELSEWHERE_PX, v=motion.v + _ELSEWHERE_PX)
        if spread == math.inf:
            return False  # marks lie on all that both pictures show
        return spread <= by_noise or spread <= _MOST_OF_ELSEWHERE * self._spread(before, now, elsewhere)

    def _widened(self, before: SearchPicture, now: SearchPicture, said: TrackedMotion) -> Floats:
        """Return the information of a motion, less where others along its weak axis fit as well."""
        return self._weak_axis.widened(_smoothed(before), _smoothed(now), said.motion, said.information)

    def _along_grain(self, before: SearchPicture, now: SearchPicture, said: TrackedMotion) -> Grain | None:
        """Return what holds a motion along the grain of the ground; None where it has none."""
        return self._grain.compare(_smoothed(before), _smoothed(now), said.motion)

    def _better(self, before: SearchPicture, now: SearchPicture, found: TrackedMotion) -> ImageMotion | None:
        """Return a motion that contradicts what was found; None where there is none."""
        assert self._guarded is not None
        return self._rivals.better(_smoothed(before), _smoothed(now), found, self._guarded.latest_vote)

    def _learn_what_stands(self, before: SearchPicture | None) -> None:
        """Take what stands still for marks where the picture as a whole has not stood still since the one before."""
        now = self._latest()
        noise = max(1.0, now.noise or 0.0)
        if before is not None and _MOST_SPREAD * noise < self._spread(before, now, _STILL) < math.inf:
            self._learn_marks(before, now, None, _SPREAD_OVER_NOISE * noise)

    def _learn_marks(self, before: SearchPicture, now: SearchPicture, motion: ImageMotion | None, sigma: float) -> None:
        if before.unmasked is not None and now.unmasked is not None:
            self._marks.add(before.unmasked, now.unmasked, motion, sigma)

    def _ignore_marks(self) -> bool:
        """Ignore what has been learned to be fixed to the lens; return whether that has changed."""
        assert self._guarded is not None
        weights = self._marks.new_weights()
        if weights is None:
            return False
        closed = closed_by(weights)
        self._guarded.ignore(weights)
        for comparison in (self._audit, self._weak_axis, self._grain, self._texture):
            comparison.ignore(closed)
        return True

    def _latest(self) -> SearchPicture:
        """Return the last picture, as the guarded tracker reads it."""
        assert self._guarded is not None
        assert self._guarded.latest is not None
        return self._guarded.latest

    def _spread(self, before: SearchPicture, now: SearchPicture, motion: ImageMotion) -> float:
        return self._audit.spread(_smoothed(before), _smoothed(now), motion)

    def _noise(self, image: Grey8) -> float:
        reference = self._active.reference
        known = None if reference is None or self._active is not self._plain else reference.noise
        return float(noise_level(image)) if known is None else known

    @staticmethod
    def _smoothed_reference(tracker: RelativeTracker) -> Grey16:
        assert tracker.reference is not None
        return _smoothed(tracker.reference)


def _smoothed(picture: SearchPicture) -> Grey16:
    """Return the picture smoothed; in mode refined it always is."""
    assert picture.smoothed is not None
    return picture.smoothed
