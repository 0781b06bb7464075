"""An experiment in several places: what is pooled, what counts, what a figure is the worst of."""

from __future__ import annotations

import importlib
import math
from dataclasses import replace
from pathlib import Path

import pytest

from trailmark.experiments import ExperimentOptions, Row
from trailmark_papers.kit import Trial, beside_faithful, over_places
from trailmark_papers.nagai2015 import straight


def options(out: Path, quick: bool = False, seed: int = 0, place: int | None = None) -> ExperimentOptions:
    return ExperimentOptions(quick=quick, seed=seed, out=out, report=print, place=place)


def rows_of_place(errors_m: dict[int, float | None]):
    """Return an experiment whose error depends on the place alone."""

    def rows(given: ExperimentOptions) -> list[Row]:
        error_m = errors_m[given.world_seed]
        return [
            Row("line", "error, mean", "m", error_m, bar=0.3, n=10, note="as the paper"),
            Row("line", "error, largest", "m", error_m, bar=0.5, n=10),
            Row("line", "right, worst of three", "%", error_m, better="higher"),
        ]

    return rows


def test_the_spread_is_over_places_and_n_counts_them(tmp_path: Path) -> None:
    mean, largest, worst = over_places(options(tmp_path), rows_of_place({1: 0.1, 1001: 0.2, 2001: 0.6}), 3)

    assert mean.ours == pytest.approx(0.3)
    assert mean.spread == pytest.approx(math.sqrt((0.04 + 0.01 + 0.09) / 3))
    assert (mean.n, mean.seeds) == (3, 3)
    assert mean.note == "as the paper; by place: 0.1, 0.2, 0.6; 30 samples"
    assert largest.ours == 0.6
    assert largest.met is False
    assert worst.ours == 0.1


def test_the_method_as_printed_is_averaged_over_places_too(tmp_path: Path) -> None:
    def rows(given: ExperimentOptions) -> list[Row]:
        printed = {1: 1.0, 1001: None, 2001: 2.0}[given.world_seed]
        return [
            Row("line", "error, mean", "m", 0.1, faithful=printed),
            Row("line", "largest", "m", 0.1, faithful=printed),
        ]

    mean, largest = over_places(options(tmp_path), rows, 3)

    assert mean.faithful == pytest.approx(1.5)
    assert largest.faithful == 2.0


def test_rows_stand_beside_those_of_the_same_item_as_printed() -> None:
    ours = [Row("line", "error", "m", 0.1, bar=0.2), Row("line", "time", "ms", 1.0), Row("line", "error", "deg", 3.0)]
    printed = [Row("line, as printed", "error", "m", 0.4, bar=0.2), Row("line", "jumps", "", 9.0)]

    found = beside_faithful(ours, printed)

    assert [row.faithful for row in found] == [0.4, None, None]
    assert [(row.experiment, row.ours, row.bar) for row in found] == [(r.experiment, r.ours, r.bar) for r in ours]


def test_a_place_where_nothing_could_be_measured_misses_the_bar(tmp_path: Path) -> None:
    mean, _, worst = over_places(options(tmp_path), rows_of_place({1: 0.1, 1001: None, 2001: 0.2}), 3)

    assert mean.ours is None
    assert mean.met is False
    assert "by place: 0.1, nothing, 0.2" in mean.note
    assert mean.n == 3
    assert (worst.ours, worst.n) == (0.1, 2)  # without a bar: of the places where there is one


def test_quick_versions_take_as_many_places_as_are_asked_for(tmp_path: Path) -> None:
    rows = rows_of_place({1: 0.1, 1001: 0.2, 2001: 0.6})
    quick = options(tmp_path, quick=True)

    assert [row.n for row in over_places(quick, rows, 5)] == [10, 10, 1]  # samples of one place
    assert [row.n for row in over_places(replace(quick, places=3), rows, 5)] == [3, 3, 3]
    assert [row.n for row in over_places(replace(options(tmp_path), places=2), rows, 5)] == [2, 2, 2]


def test_a_row_that_one_place_alone_has_is_kept(tmp_path: Path) -> None:
    def rows(given: ExperimentOptions) -> list[Row]:
        extra = [Row("line", "extra", "m", 1.0)] if given.world_seed == 1001 else []
        return [Row("line", "error", "m", 0.1), *extra]

    found = over_places(options(tmp_path), rows, 2)

    assert [(row.item, row.n) for row in found] == [("error", 2), ("extra", 1)]


def test_every_place_has_seeds_and_a_folder_of_its_own(tmp_path: Path) -> None:
    seen: list[Trial] = []

    def rows(given: ExperimentOptions) -> list[Row]:
        seen.append(Trial.of(given))
        return []

    over_places(options(tmp_path, seed=4), rows, 2)

    assert seen == [Trial(tmp_path, 4, 5), Trial(tmp_path / "places" / "1005", 1004, 1005)]


def test_a_fixed_place_has_other_seeds_in_other_folders(tmp_path: Path) -> None:
    seen: list[Trial] = []

    def rows(given: ExperimentOptions) -> list[Row]:
        seen.append(Trial.of(given))
        return []

    over_places(options(tmp_path, place=7), rows, 3)

    assert [(trial.seed, trial.place) for trial in seen] == [(0, 7), (1000, 7), (2000, 7)]
    assert len({trial.out for trial in seen}) == 3


def test_seeds_of_a_fixed_place_are_of_one_place(tmp_path: Path) -> None:
    mean, _, _ = over_places(options(tmp_path, place=7), rows_of_place({7: 0.1}), 3)

    assert (mean.n, mean.seeds) == (1, 3)
    assert mean.note == "as the paper; by seed: 0.1, 0.1, 0.1; 30 samples"


@pytest.mark.parametrize(("item", "ours"), [("error, max", 0.6), ("maximum-likelihood error", 0.3)])
def test_a_word_within_another_makes_no_worst(tmp_path: Path, item: str, ours: float) -> None:
    def rows(given: ExperimentOptions) -> list[Row]:
        return [Row("line", item, "m", {1: 0.1, 1001: 0.2, 2001: 0.6}[given.world_seed])]

    assert over_places(options(tmp_path), rows, 3)[0].ours == pytest.approx(ours)


def test_the_quick_version_keeps_to_one_place_and_its_rows(tmp_path: Path) -> None:
    rows = rows_of_place({3: 0.1})

    assert over_places(options(tmp_path, quick=True, seed=2), rows, 5) == rows(options(tmp_path, seed=2))


@pytest.mark.parametrize("paper", ["nagai2015", "perroni2014", "tasaki2010", "toth2015"])
def test_every_part_of_a_paper_takes_place_in_five_places(
    paper: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Times are left out: a picture takes as long anywhere."""
    module = importlib.import_module(f"trailmark_papers.{paper}")
    parts: dict[str, int] = {}
    monkeypatch.setattr(module, "over_places", lambda _, rows_of, n: parts.update({rows_of.__name__: n}) or [])
    monkeypatch.setattr("trailmark_papers.perroni2014.frame_time.frame_time_rows", lambda _: [])
    if paper == "nagai2015":
        monkeypatch.setattr(module, "time_rows", lambda _: [])
        monkeypatch.setattr(module, "straight_rows", lambda _: [])
        parts["straight_rows"] = straight._SEEDS

    getattr(module, paper)(options(tmp_path))

    assert parts
    assert min(parts.values()) >= 5
