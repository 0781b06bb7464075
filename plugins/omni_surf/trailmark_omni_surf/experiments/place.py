"""The place of the experiments: taught once, its landmarks selected by a machine that was trained in another one."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from trailmark.experiments import ExperimentOptions
from trailmark.interfaces import Session
from trailmark.paths import Keyframe
from trailmark.pipeline import RunResult
from trailmark_omni_surf.experiments.labels import labelled_candidates
from trailmark_omni_surf.experiments.variants import Variant
from trailmark_omni_surf.landmark_map import Candidates, LandmarkMap, measured_candidates
from trailmark_omni_surf.laser.scan_map import ScanMap
from trailmark_omni_surf.selection import SelectionModel, shipped_model
from trailmark_omni_surf.training import train

__all__ = ["START", "TaughtPlace", "supermarket", "taught_place"]

#: Where the taught route begins: x, y [m], heading [deg].
START = (1.0, 2.0, 0.0)
_TEST_SEED, _TRAINING_SEED = 1, 2  # two supermarkets with other goods, signs and posters
_QUICK_S = 13.0  # of teaching: the line by the wall and the corner after it
_N_LONGEST, _PAPER_N_LONGEST, _N_TRAINING = 40, 9, 100
_ALL = 100_000


@dataclass(frozen=True, slots=True)
class TaughtPlace:
    """What was taught, and the maps that can be made of it.

    Attributes
    ----------
    store : Path
        The path store, with the landmarks of the default config selected by the trained machine.
    variants : dict
        Localizers with their maps, by name.
    n_candidates, n_landmarks : int
        Of the default K, and how many the machine took.
    training : str
        What the machine was trained on, in words.
    """

    store: Path
    variants: dict[str, Variant]
    n_candidates: int
    n_landmarks: int
    training: str


def supermarket(**more: Any) -> dict[str, Any]:
    """Return the config of the source, one thread, with its three sensors."""
    common = {"plugin": "sim", "world": "supermarket", "threads": 1, "sensors": ["wheels", "laser", "omni"]}
    return common | more


def taught_place(options: ExperimentOptions) -> TaughtPlace:
    """Teach the supermarket, and in the full version another one first, for training."""
    model_path, training = options.out / "selection.npz", "the shipped machine (1000 synthetic candidates)"
    options.out.mkdir(parents=True, exist_ok=True)
    if options.quick:
        shipped_model().save(model_path)
    else:
        training = _train_elsewhere(options, model_path)
    options.report(f"training: {training}")
    store = options.out / "market.trail"
    _teach(options, store, _TEST_SEED, model_path)
    keyframes, _ = _keyframes(store)
    candidates = measured_candidates(keyframes, _N_LONGEST)
    chosen = SelectionModel.load(model_path).probability(candidates.features) >= 0.5
    variants = _variants(options, keyframes, candidates, chosen)
    options.report(f"taught: {int(chosen.sum())} landmarks of {len(chosen)} candidates")
    return TaughtPlace(store, variants, len(chosen), int(chosen.sum()), training)


def _teach(options: ExperimentOptions, store: Path, world_seed: int, model: Path | None) -> RunResult:
    """Drive through all aisles with nobody about; the laser and the wheels know the poses."""
    from trailmark.api import run

    omni: dict[str, Any] = {"plugin": "omni_surf", "camera": "omni"}
    if model is not None:
        omni["model"] = str(model)
    source = supermarket(route="round", world_seed=world_seed)
    if options.quick:
        source["duration_s"] = _QUICK_S
    config = {
        "sources": {"robot": source},
        "localizers": {
            "wheels": {"plugin": "odometry"},
            "omni": omni,
            "laser": {"plugin": "laser_icp", "laser": "laser"},
        },
        "estimator": {"plugin": "kalman"},
        "start": list(START),
        "seed": options.seed,
    }
    folder = options.out / "runs" / f"teach-{world_seed}"
    return run(config, folder, mode="teach", store=store, access="overwrite", overwrite=True, report=False)


def _keyframes(store: Path) -> tuple[list[Keyframe], list[Keyframe]]:
    """Return what the camera and what the laser remembered."""
    from trailmark.api import create

    opened = create("path_store", "sqlite", path=str(store), access="read")
    opened.start(Session(mode="replay"))
    try:
        return list(opened.drawer("omni").keyframes()), list(opened.drawer("laser").keyframes())
    finally:
        opened.close()


def _train_elsewhere(options: ExperimentOptions, model_path: Path) -> str:
    """Train on N = 100 candidates of another supermarket, labelled by |measured - true| < T_d."""
    store = options.out / "training.trail"
    taught = _teach(options, store, _TRAINING_SEED, None)
    assert taught.ground_truth is not None
    seen, scans = _keyframes(store)
    truth = dict(taught.ground_truth.at(sorted({frame.stamp_s for frame in [*seen, *scans]})))
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


def _variants(
    options: ExperimentOptions, keyframes: list[Keyframe], candidates: Candidates, chosen: npt.NDArray[np.bool_]
) -> dict[str, Variant]:
    """Return the localizers that are compared, each with its own map of the same drive."""
    rng = np.random.default_rng(options.seed)
    random = np.zeros(len(chosen), dtype=bool)
    random[rng.permutation(len(chosen))[: int(chosen.sum())]] = True
    everything = measured_candidates(keyframes, _ALL)
    few = measured_candidates(keyframes, _PAPER_N_LONGEST)
    few_chosen = SelectionModel.load(options.out / "selection.npz").probability(few.features) >= 0.5
    trusting = {
        "min_agreeing": 4,
        "max_rival_share": 1.0,
        "min_agreeing_share": 0.0,
        "max_gap_deg": 360.0,
        "confirm_pictures": 1,
    }
    selected = _saved(options, "selected", candidates, chosen)
    all_points = _saved(options, "all-points", everything, np.ones(len(everything.ids), dtype=bool))
    found = [
        Variant("developed", selected, {}),
        Variant("simple", all_points, {"use_tracking": False, **trusting}),
        Variant("plain", all_points, {}, is_plain=True),
        Variant("detected", selected, {"use_tracking": False}),
        Variant("paper", _saved(options, "paper", few, few_chosen), {"refresh_every": _ALL, **trusting}),
        Variant("unselected", _saved(options, "unselected", candidates, np.ones(len(chosen), dtype=bool)), {}),
        Variant("random", _saved(options, "random", candidates, random), {}),
    ]
    return {variant.name: variant for variant in found}


def _saved(options: ExperimentOptions, name: str, candidates: Candidates, chosen: npt.NDArray[np.bool_]) -> Path:
    """Write a map and return where it is."""
    path = options.out / f"map-{name}.npz"
    np.savez(path, **LandmarkMap.of(candidates, chosen, "surf").to_arrays())  # type: ignore[arg-type]
    return path
