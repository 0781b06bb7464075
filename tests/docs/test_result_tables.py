"""Programs that make tables of pages: what is done is kept and not done again, and rows become lines."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType

import pytest


@pytest.fixture(scope="module")
def places(load_script: Callable[[str], ModuleType]) -> ModuleType:
    return load_script("benchmarks/foreign_places.py")


def test_places_that_are_done_are_summed_and_not_done_again(
    places: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun = []

    def starts(name: str, *told_s: float | None) -> Callable[[], Iterator[object]]:
        def yielded() -> Iterator[object]:
            begun.append(name)
            for at_s in told_s:
                yield places.Start("street", "its own", None if at_s is None else True, at_s)
            yield places.Start("street", "another place", False, 1.0)

        return yielded

    streets = {"street 1": starts("street 1", 1.0, None), "street 2": starts("street 2", 9.0)}
    monkeypatch.setattr(places, "METHODS", {"divs": lambda is_quick: streets})
    kept = tmp_path / "kept.jsonl"

    only_one = places.summed(list(places.measured(["divs"], ["street 1"], False, kept)))
    both = places.summed(list(places.measured(["divs"], [], False, kept)))

    assert begun == ["street 1", "street 2"]
    assert only_one[0].line() == "| divs | street | its own | 1, 1 within 3 s | 0 | 2 |"
    assert [row.line() for row in both] == [
        "| divs | street | its own | 2, 1 within 3 s | 0 | 3 |",
        "| divs | street | another place | - | 2 | 2 |",
    ]


def test_a_robot_is_a_line_with_ratios_to_its_clean_run(load_script: Callable[[str], ModuleType]) -> None:
    tables = load_script("benchmarks/fusion_tables.py")
    clean = {"robot": 1, "case": "clean", "rmse_m": 0.2, "max_m": 1.0, "settled_s": 0.0, "settled_rmse_m": 0.2}
    late = clean | {"case": "late", "rmse_m": 0.3}

    assert tables.robots([clean, late]).splitlines()[-1] == "| R1 | 0.200 (0.26, 0.18) | 1.00 | 1.50 | - | - | - |"


def test_only_what_was_measured_of_a_drive_stands_in_its_line(load_script: Callable[[str], ModuleType]) -> None:
    winding = load_script("benchmarks/divs_winding.py")
    answers = winding.Answers([0.1, 0.2, 0.3], 3)
    rows = [
        *winding._answer_rows("street, same light", "divs", answers, 0.25, 10),
        *winding._answer_rows("street, same light", "patch_ncc", answers, 0.25, 10),
        *winding._start_rows("street", [(1.0, 0.1), (2.0, 5.0), (None, 0.0), (3.0, 0.0)]),
    ]

    lines = winding.markdown(rows).splitlines()

    assert lines[2] == "| street, same light | `divs` | 0.200 | 0.290 | 100.0 % | 100.0 % | met |"
    assert lines[3].endswith("| 100.0 % | 100.0 % |  |")  # no bar is asked of a peer
    assert lines[-1] == "| street, unknown start | 50.0 % | 25.0 % | 4 |"
