"""The place of the experiments: taught once, and the maps that are made of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from trailmark.arrays import Bools
from trailmark.experiments import ExperimentOptions
from trailmark.paths import Keyframe
from trailmark.pipeline import RunResult
from trailmark_omni_surf.config import OmniSurfConfig
from trailmark_omni_surf.landmark_map import Candidates, LandmarkMap, measured_candidates
from trailmark_omni_surf.laser.scan_map import ScanMap
from trailmark_omni_surf.selection import SelectionModel, shipped_model
from trailmark_omni_surf.training import train
from trailmark_papers.kit import keyframes_of, run_config, sim_source, truth_of
from trailmark_papers.tasaki2010.labels import labelled_candidates
from trailmark_papers.tasaki2010.variants import Variant

__all__ = ["START", "TaughtPlace", "localized_by", "supermarket", "taught_place"]

#: Where the taught route begins: x, y [m], heading [deg].
START = (1.0, 2.0, 0.0)
#: The camera's localizer, as it is and as printed; both remember the place when it is taught.
_CAMERAS: Mapping[str, Mapping[str, Any]] = {
    "omni": {"plugin": "omni_surf", "camera": "omni"},
    "faithful": {"plugin": "omni_surf", "camera": "omni", "preset": "paper"},
}
_QUICK_S = 13.0  # of teaching: the line by the wall and the corner after it
_N_LONGEST, _N_TRAINING = 40, 100
_PAPER_N_LONGEST: int = OmniSurfConfig.presets["paper"]["n_longest"].value
_ALL = 100_000
#: A place is believed as the paper says: more than three landmarks.
_TRUSTING = {
    "min_agreeing": 4,
    "max_rival_share": 1.0,
    "min_agreeing_share": 0.0,
    "max_gap_deg": 360.0,
    "confirm_pictures": 1,
}
#: What differs from the default config, by variant.
_CONFIGS: dict[str, dict[str, Any]] = {
    "simple": {"use_tracking": False, **_TRUSTING},
    "detected": {"use_tracking": False},
    **{name: {"preset": "paper"} for name in ("paper", "paper, trained", "paper, unselected")},
}


@dataclass(frozen=True, slots=True)
class TaughtPlace:
    """What was taught, and the maps that can be made of it.

    Attributes
    ----------
    world_seed : int
        Which supermarket: goods, signs and posters; walls and shelves are those of all.
    store : Path
        The path store, taught with the default config: the shipped machine selects the landmarks.
    variants : dict
        Localizers with their maps, by name.
    sizes : dict
        How many landmarks each map has, by the name of its variant.
    training : str
        What the machine of the variant "trained" was trained on, in words; empty without it.
    world : mapping
        Options of the world, where they are not the default ones.
    """

    world_seed: int
    store: Path
    variants: dict[str, Variant]
    sizes: dict[str, int]
    training: str
    world: Mapping[str, Any] = field(default_factory=dict)

    def source(self, **more: Any) -> dict[str, Any]:
        """Return the config of the source in this place."""
        given = {"options": {**self.world, **more.pop("options", {})}}
        return supermarket(world_seed=self.world_seed, **given, **more)


def localized_by(*cameras: str) -> dict[str, Any]:
    """Return the part of a config that localizes: wheels, laser and these of the camera's localizers, fused."""
    chosen = {name: dict(_CAMERAS[name]) for name in cameras}
    parts = {"wheels": {"plugin": "odometry"}, **chosen, "laser": {"plugin": "laser_icp", "laser": "laser"}}
    return {"localizers": parts, "estimator": {"plugin": "kalman"}}


def supermarket(**more: Any) -> dict[str, Any]:
    """Return the config of the source, one thread, with its three sensors."""
    common: dict[str, Any] = {"threads": 1, "sensors": ["wheels", "laser", "omni"]}
    return sim_source("supermarket", **(common | more))


def taught_place(options: ExperimentOptions, world: Mapping[str, Any] | None = None) -> TaughtPlace:
    """Teach the supermarket, and in the full version another one first, to train a selection there.

    Parameters
    ----------
    world : mapping, optional
        Options of both supermarkets, where they are not the default ones.
    """
    world = world or {}
    options.out.mkdir(parents=True, exist_ok=True)
    world_seed = options.world_seed
    model_path, training = options.out / "selection.npz", ""
    if not options.quick:
        training = _train_elsewhere(options, model_path, world_seed + 1, world)
        options.report(f"training: {training}")
    store = options.out / "market.trail"
    _teach(options, store, world_seed, world)
    keyframes = keyframes_of(store, "omni")
    candidates = measured_candidates(keyframes, _N_LONGEST)
    trained = None if options.quick else SelectionModel.load(model_path)
    maps = _maps(options, keyframes, candidates, trained)
    variants = {name: _variant(options, name, *made) for name, made in maps.items()}
    sizes = {name: int(made[1].sum()) for name, made in maps.items()}
    options.report(f"taught: {sizes['developed']} landmarks of {len(candidates.ids)} candidates")
    return TaughtPlace(world_seed, store, variants, sizes, training, world)


def _teach(options: ExperimentOptions, store: Path, world_seed: int, world: Mapping[str, Any]) -> RunResult:
    """Drive through all aisles without people; the laser and the wheels measure the poses."""
    limits = {"duration_s": _QUICK_S} if options.quick else {}
    config = {
        "sources": {"robot": supermarket(route="round", world_seed=world_seed, options=dict(world), **limits)},
        **localized_by(*_CAMERAS),
        "start": list(START),
        "seed": options.seed,
    }
    return run_config(config, options.out / "runs" / f"teach-{world_seed}", "teach", store=store)


def _train_elsewhere(options: ExperimentOptions, model_path: Path, world_seed: int, world: Mapping[str, Any]) -> str:
    """Train on N = 100 candidates of another supermarket, labelled by |measured - true| < T_d."""
    store = options.out / "training.trail"
    taught = truth_of(_teach(options, store, world_seed, world))
    seen, scans = keyframes_of(store, "omni"), keyframes_of(store, "laser")
    truth = dict(taught.at(sorted({frame.stamp_s for frame in [*seen, *scans]})))
    points = [frame.arrays["points"].astype(np.float64) for frame in scans]
    walls = ScanMap.from_scans(points, [truth[frame.stamp_s] for frame in scans])
    features, is_good = labelled_candidates(seen, truth, walls, measured_candidates(seen, _N_LONGEST))
    chosen = np.random.default_rng(options.seed).permutation(len(features))[:_N_TRAINING]
    model, report = train(features[chosen], is_good[chosen])
    model.save(model_path)
    rest = np.setdiff1d(np.arange(len(features)), chosen)
    hits = (model.probability(features[rest]) >= 0.5) == is_good[rest]
    return (
        f"{report.n} candidates of another supermarket, {report.n_good} good; accuracy {report.accuracy:.2f} "
        f"cross-validated, {float(hits.mean()):.2f} on the other {len(rest)} of that place"
    )


def _maps(
    options: ExperimentOptions, keyframes: list[Keyframe], candidates: Candidates, trained: SelectionModel | None
) -> dict[str, tuple[Candidates, Bools]]:
    """Return candidates of the same drive and which of them become landmarks, by the name of the variant."""
    shipped = shipped_model()
    chosen = shipped.probability(candidates.features) >= 0.5
    every = np.ones(len(chosen), dtype=bool)
    everything = measured_candidates(keyframes, _ALL)
    all_points = (everything, np.ones(len(everything.ids), dtype=bool))
    few = measured_candidates(keyframes, _PAPER_N_LONGEST)
    as_printed = (few, shipped.probability(few.features) >= 0.5)
    maps = {"developed": (candidates, chosen), "simple": all_points, "plain": all_points, "paper": as_printed}
    if trained is None:
        return maps
    printed = {
        "paper, trained": (few, trained.probability(few.features) >= 0.5),
        "paper, unselected": (few, np.ones(len(few.ids), dtype=bool)),
    }
    random = np.zeros(len(chosen), dtype=bool)
    random[np.random.default_rng(options.seed).permutation(len(chosen))[: int(chosen.sum())]] = True
    return (
        maps
        | printed
        | {
            "detected": (candidates, chosen),
            "trained": (candidates, trained.probability(candidates.features) >= 0.5),
            "unselected": (candidates, every),
            "random": (candidates, random),
        }
    )


def _variant(options: ExperimentOptions, name: str, candidates: Candidates, chosen: Bools) -> Variant:
    """Write a map and return the localizer that uses it."""
    path = options.out / f"map-{name.replace(', ', '-')}.npz"
    np.savez(path, **LandmarkMap.of(candidates, chosen, "surf").to_arrays())  # type: ignore[arg-type]
    return Variant(name, path, _CONFIGS.get(name, {}), is_plain=name == "plain")
