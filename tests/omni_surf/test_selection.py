"""Selection of landmarks: training, its plain prediction, and labels from a CSV."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from sklearn.svm import SVC

from trailmark.errors import ConfigError, ShapeError
from trailmark_omni_surf.commands import omni as omni_group
from trailmark_omni_surf.selection import SelectionModel, log_features, shipped_model
from trailmark_omni_surf.synthetic import synthetic_candidates
from trailmark_omni_surf.training import read_candidates, train, write_candidates


@pytest.fixture(scope="module")
def hundred() -> tuple[np.ndarray, np.ndarray]:
    return synthetic_candidates(100, np.random.default_rng(7))


@pytest.fixture(scope="module")
def unseen() -> tuple[np.ndarray, np.ndarray]:
    return synthetic_candidates(600, np.random.default_rng(8))


def test_the_plain_prediction_equals_scikit_learn(hundred: tuple, unseen: tuple) -> None:
    model, _ = train(*hundred)
    machine = SVC(kernel="rbf", C=10.0, gamma=1 / 6).fit(
        (log_features(hundred[0]) - model.mean) / model.scale, hundred[1]
    )

    expected = machine.decision_function((log_features(unseen[0]) - model.mean) / model.scale)

    np.testing.assert_allclose(model.decision(unseen[0]), expected, atol=1e-9)


def test_selected_candidates_are_better_than_random_ones(unseen: tuple) -> None:
    features, is_good = unseen

    chosen = shipped_model().probability(features) >= 0.5

    assert is_good[chosen].mean() > is_good.mean() + 0.2
    assert chosen[is_good].mean() > 0.6


def test_probabilities_grow_with_the_decision_and_are_calibrated(unseen: tuple) -> None:
    features, is_good = unseen
    model = shipped_model()
    probability, order = model.probability(features), np.argsort(model.decision(features))

    assert (np.diff(probability[order]) >= 0).all()
    assert abs(probability.mean() - is_good.mean()) < 0.08


def test_a_model_survives_the_file(tmp_path: Path, hundred: tuple) -> None:
    model, report = train(*hundred)
    model.save(tmp_path / "model.npz")

    again = SelectionModel.load(tmp_path / "model.npz")

    np.testing.assert_array_equal(again.probability(hundred[0]), model.probability(hundred[0]))
    assert report.n == 100
    assert 0.6 < report.accuracy <= 1.0


def test_a_foreign_file_is_no_model(tmp_path: Path) -> None:
    (tmp_path / "other.npz").write_bytes(b"no archive")

    with pytest.raises(ConfigError, match="no selection model"):
        SelectionModel.load(tmp_path / "other.npz")


def test_features_of_another_width_are_refused() -> None:
    with pytest.raises(ShapeError, match=r"\(N, 6\)"):
        log_features(np.ones((3, 5)))


def test_one_label_alone_is_refused() -> None:
    with pytest.raises(ConfigError, match="not 10 good and 0 bad"):
        train(np.ones((10, 6)), np.ones(10, dtype=bool))


def label(path: Path, is_good: np.ndarray) -> None:
    """Fill in true places by hand: at the measured one, or 2 m away."""
    lines = path.read_text().splitlines()
    rows = [line.split(",") for line in lines[1:]]
    for row, good in zip(rows, is_good):
        row[-2:] = [repr(float(row[6]) + (0.1 if good else 2.0)), row[7]]
    path.write_text("\n".join([lines[0], *(",".join(row) for row in rows)]) + "\n")


def test_labels_come_from_true_places_in_a_csv(tmp_path: Path, hundred: tuple) -> None:
    features, is_good = hundred
    path = tmp_path / "candidates.csv"
    write_candidates(path, features, np.zeros((100, 2)))
    with pytest.raises(ConfigError, match="fill in true_x and true_y"):
        read_candidates(path)
    label(path, is_good)

    read, labels = read_candidates(path)

    np.testing.assert_array_equal(read, features)
    np.testing.assert_array_equal(labels, is_good)


def test_a_bad_csv_names_its_line_or_column(tmp_path: Path) -> None:
    path = tmp_path / "bad.csv"
    write_candidates(path, np.ones((1, 6)), np.zeros((1, 2)))
    path.write_text(path.read_text().replace("1.0,1.0", "1.0,many", 1).replace(",,", ",0,0"))
    with pytest.raises(ConfigError, match=r"line 2: error_rad2 is no number: 'many'"):
        read_candidates(path)
    path.write_text("a,b\n1,2\n")
    with pytest.raises(ConfigError, match="lacks the column n_observations"):
        read_candidates(path)
    with pytest.raises(ConfigError, match="cannot read"):
        read_candidates(tmp_path / "missing.csv")


def test_the_command_trains_from_a_csv_and_from_geometry(tmp_path: Path, hundred: tuple) -> None:
    path = tmp_path / "candidates.csv"
    write_candidates(path, hundred[0], np.zeros((100, 2)))
    label(path, hundred[1])

    from_csv = CliRunner().invoke(omni_group, ["train", str(path), "--out", str(tmp_path / "a.npz")])
    synthetic = CliRunner().invoke(
        omni_group, ["train", "--synthetic", "60", "--out", str(tmp_path / "b.npz"), "--json"]
    )

    assert from_csv.exit_code == 0, from_csv.output
    assert "100 candidates" in from_csv.output
    assert synthetic.exit_code == 0, synthetic.output
    assert '"n": 60' in synthetic.output
    assert SelectionModel.load(tmp_path / "b.npz").support.shape[1] == 6


def test_the_command_wants_one_source_of_labels(tmp_path: Path) -> None:
    result = CliRunner().invoke(omni_group, ["train", "--out", str(tmp_path / "a.npz")])

    assert isinstance(result.exception, ConfigError)
    assert "either a CSV or --synthetic" in str(result.exception)
