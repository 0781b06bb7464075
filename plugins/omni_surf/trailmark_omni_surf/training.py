"""Training of the landmark selection with scikit-learn; nothing here is needed to localize."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from sklearn.calibration import CalibratedClassifierCV
from sklearn.model_selection import cross_val_predict
from sklearn.svm import SVC

from trailmark.arrays import Bools, Floats
from trailmark.errors import ConfigError
from trailmark_omni_surf.landmarks import FEATURE_NAMES
from trailmark_omni_surf.selection import SelectionModel, log_features

__all__ = ["TrainingReport", "read_candidates", "train", "write_candidates"]


_PLACE_COLUMNS = ("measured_x", "measured_y", "true_x", "true_y")
_N_FOLDS = 5


@dataclass(frozen=True, slots=True)
class TrainingReport:
    """How good the machine is on candidates that it was not trained on.

    Attributes
    ----------
    n, n_good : int
        Candidates, and good ones among them.
    accuracy : float
        Share of right answers, five-fold cross-validated.
    precision, recall : float
        Of the selected ones, how many are good; of the good ones, how many are selected.
    """

    n: int
    n_good: int
    accuracy: float
    precision: float
    recall: float


def train(features: Floats, is_good: Bools, c: float = 10.0) -> tuple[SelectionModel, TrainingReport]:
    """Train an RBF machine with scaling and a sigmoid for its probability.

    Parameters
    ----------
    features : (N, 6) float64
        In the order of `FEATURE_NAMES`.
    is_good : (N,) bool
        Labels.
    c : float
        Penalty of a wrong side.

    Raises
    ------
    ConfigError
        If there are fewer than five candidates of either label.
    """
    n_good = int(is_good.sum())
    if min(n_good, len(is_good) - n_good) < _N_FOLDS:
        raise ConfigError(
            f"training needs at least {_N_FOLDS} good and {_N_FOLDS} bad candidates, "
            f"not {n_good} good and {len(is_good) - n_good} bad; the paper used 100 in all"
        )
    x = log_features(features)
    mean, scale = x.mean(axis=0), np.maximum(x.std(axis=0), 1e-9)
    x = (x - mean) / scale
    gamma = 1.0 / x.shape[1]
    machine = SVC(kernel="rbf", C=c, gamma=gamma)
    predicted = cross_val_predict(machine, x, is_good, cv=_N_FOLDS)
    calibrated = CalibratedClassifierCV(machine, method="sigmoid", cv=_N_FOLDS, ensemble=False).fit(x, is_good)
    fitted = calibrated.calibrated_classifiers_[0]
    sigmoid = fitted.calibrators[0]
    model = SelectionModel(
        mean,
        scale,
        np.asarray(fitted.estimator.support_vectors_),
        np.asarray(fitted.estimator.dual_coef_[0]),
        np.asarray(fitted.estimator.intercept_[0]),
        np.asarray(gamma),
        np.array([sigmoid.a_, sigmoid.b_]),
    )
    return model, _report(predicted, is_good)


def _report(predicted: Bools, is_good: Bools) -> TrainingReport:
    hits = int((predicted & is_good).sum())
    return TrainingReport(
        len(is_good),
        int(is_good.sum()),
        float((predicted == is_good).mean()),
        hits / max(1, int(predicted.sum())),
        hits / max(1, int(is_good.sum())),
    )


def read_candidates(path: Path, label_distance_m: float = 0.6) -> tuple[Floats, Bools]:
    """Read candidates and their labels: |measured - true| < T_d. Rows without a true place are left out.

    Parameters
    ----------
    path : Path
        CSV with a header: the six features, ``measured_x``, ``measured_y``, ``true_x``, ``true_y``.
    label_distance_m : float
        T_d, 0.6 m in the paper [m].

    Raises
    ------
    ConfigError
        If the file, a column or a number is missing, with the line.
    """
    features: list[list[float]] = []
    labels: list[bool] = []
    try:
        with path.open(newline="", encoding="utf-8") as stream:
            reader = csv.DictReader(stream)
            missing = [name for name in (*FEATURE_NAMES, *_PLACE_COLUMNS) if name not in (reader.fieldnames or ())]
            if missing:
                raise ConfigError(f"{path} lacks the column {missing[0]}; it needs {', '.join(FEATURE_NAMES)} and "
                                  f"{', '.join(_PLACE_COLUMNS)}")  # fmt: skip
            for row in reader:
                if not (row["true_x"] and row["true_y"]):
                    continue
                x, y, true_x, true_y = (_number(row, name, path, reader.line_num) for name in _PLACE_COLUMNS)
                features.append([_number(row, name, path, reader.line_num) for name in FEATURE_NAMES])
                labels.append(bool(np.hypot(x - true_x, y - true_y) < label_distance_m))
    except UnicodeDecodeError as error:
        raise ConfigError(f"cannot read {path}: it is no text (byte {error.start})") from error
    except OSError as error:
        raise ConfigError(f"cannot read {path}: {error.strerror or error}") from error
    if not features:
        raise ConfigError(f"{path} holds no candidate with a true place: fill in true_x and true_y")
    return np.array(features), np.array(labels)


def _number(row: dict[str, str], name: str, path: Path, line: int) -> float:
    try:
        value = float(row[name])
    except (TypeError, ValueError):
        value = float("nan")
    if not np.isfinite(value):
        raise ConfigError(f"{path} line {line}: {name} is no number: {row[name]!r}")
    return value


def write_candidates(path: Path, features: Floats, measured: Floats) -> None:
    """Write candidates to be labelled by hand: ``true_x`` and ``true_y`` are left empty."""
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow([*FEATURE_NAMES, *_PLACE_COLUMNS])
        for row, place in zip(features, measured):
            writer.writerow([*(repr(float(value)) for value in (*row, *place)), "", ""])
