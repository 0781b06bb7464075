"""From a bench config to cells."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from trailmark.errors import ConfigError
from trailmark_bench import load_bench
from trailmark_bench.overlay import overlaid


def labels(bench) -> list[str]:
    return [cell.label for cell in bench.cells]


def test_every_value_is_crossed_with_every_other(bench_of) -> None:
    cells = {
        "sources": {"short": {"plugin": "toy_wheels", "n": 10}, "long": {"plugin": "toy_wheels", "n": 20}},
        "localizers": {"a": "toy", "b": {"plugin": "toy", "scale": 1.1}},
        "seeds": 2,
    }

    bench = bench_of(cells, run={"sources": {}})

    assert labels(bench) == [f"{s}, {m}, seed {i}" for s in ("short", "long") for m in "ab" for i in range(2)]
    assert len({cell.id for cell in bench.cells}) == 8
    assert bench.cells[2].request["document"]["localizers"]["b"]["scale"] == 1.1


def test_a_list_of_localizers_names_plugins(bench_of) -> None:
    assert labels(bench_of({"localizers": ["toy", "odometry"]})) == ["toy, seed 0", "odometry, seed 0"]


def test_a_value_may_be_several_parts_beside_those_of_the_run(bench_of) -> None:
    pair = {"pair": {"first": {"plugin": "toy"}, "second": {"plugin": "toy", "scale": 1.1}}}
    run = {"localizers": {"shared": {"plugin": "odometry"}}, "estimator": {"use": ["shared"]}}

    (cell,) = bench_of({"localizers": pair}, run=run).cells

    assert list(cell.request["document"]["localizers"]) == ["shared", "first", "second"]
    assert cell.request["localizer"] == "first"


def test_figures_are_told_of_the_localizer_that_they_are_about(bench_of) -> None:
    pair = {"about": "second", "first": {"plugin": "toy"}, "second": {"plugin": "odometry"}}
    run = {"estimator": {"use": ["first"]}}

    (cell,) = bench_of({"localizers": {"pair": pair}}, run=run, judging={"trajectory": "localizer"}).cells

    assert (cell.request["localizer"], cell.request["subject"]) == ("second", "second")
    with pytest.raises(ConfigError, match=r"no localizer is called 'secnd' \(did you mean 'second'"):
        bench_of({"localizers": {"pair": pair | {"about": "secnd"}}}, run=run)


def test_pipelines_estimators_and_perturbations_are_axes(bench_of) -> None:
    cells = {
        "localizers": ["toy"],
        "estimators": ["dead_reckoning", "kalman"],
        "pipelines": {"slow": {"control_hz": 10}, "fast": {"control_hz": 100}},
        "perturbations": {"clean": {}, "gaps": {"dropped": 0.2}},
    }

    bench = bench_of(cells)

    assert len(bench.cells) == 8
    last = bench.cells[-1]
    assert last.label == "gaps, toy, kalman, fast, seed 0"
    assert last.request["document"]["estimator"]["plugin"] == "kalman"
    assert last.request["document"]["control_hz"] == 100
    assert last.request["document"]["sources"]["robot"]["perturb"]["dropped"] == 0.2


def test_several_matrices_share_a_run_and_have_their_own(bench_of) -> None:
    cells = [
        {"name": "one", "localizers": ["toy"], "seeds": [3, 7]},
        {"name": "two", "localizers": ["odometry"], "config": {"sources": {"robot": {"plugin": "toy_wheels", "n": 9}}}},
    ]

    bench = bench_of(cells)

    assert labels(bench) == ["one, toy, seed 3", "one, toy, seed 7", "two, odometry, seed 0"]
    assert bench.cells[-1].request["document"]["sources"]["robot"]["n"] == 9


def test_a_matrix_may_be_judged_in_its_own_way(bench_of) -> None:
    one, other = (
        {"name": "one", "localizers": ["toy"]},
        {"name": "other", "localizers": ["toy"], "judging": {"align": "none"}},
    )

    first, second = bench_of([one, other], judging={"align": "origin"}).cells

    assert (first.request["align"], second.request["align"]) == ("origin", "none")
    assert first.id != second.id  # the same run, and figures that must not be mixed up


def test_matrices_without_names_are_refused(bench_of) -> None:
    with pytest.raises(ConfigError, match="several matrices need a 'name' each"):
        bench_of([{"localizers": ["toy"]}, {"localizers": ["odometry"]}])


def test_combinations_are_left_out_by_name_and_pattern(bench_of) -> None:
    cells = {
        "localizers": {"a": "toy", "b": {"plugin": "toy", "scale": 2.0}},
        "perturbations": {"clean": {}, "noise_1": {"dropped": 0.1}, "noise_2": {"dropped": 0.2}},
        "exclude": [{"localizer": "b", "perturbation": "noise_*"}],
    }

    assert labels(bench_of(cells)) == [
        "clean, a, seed 0",
        "clean, b, seed 0",
        "noise_1, a, seed 0",
        "noise_2, a, seed 0",
    ]


def test_a_misspelt_exclusion_is_refused_with_the_nearest_name(bench_of) -> None:
    cells = {"localizers": ["toy", "odometry"], "exclude": [{"localizer": "odomtry"}]}

    with pytest.raises(ConfigError, match=r"no localizer is called 'odomtry' \(did you mean 'odometry'\?\)"):
        bench_of(cells)


def test_only_takes_patterns_and_refuses_what_fits_no_cell(bench_of) -> None:
    cells = {"localizers": ["toy", "odometry"], "seeds": 3}

    assert labels(bench_of(cells, only=["localizer=od*", "seed=1,2"])) == ["odometry, seed 1", "odometry, seed 2"]
    with pytest.raises(ConfigError, match="--only localizer=orb: no cell has such a localizer"):
        bench_of(cells, only=["localizer=orb"])
    with pytest.raises(ConfigError, match=r"no axis is called 'localiser' \(did you mean 'localizer'"):
        bench_of(cells, only=["localiser=toy"])


def test_only_some_places_leaves_matrices_that_have_none_alone(bench_of) -> None:
    places = {"here": {}, "there": {"sources": {"robot": {"n": 50}}}}
    cells = [{"name": "many", "places": places, "localizers": ["toy"]}, {"name": "one", "localizers": ["toy"]}]

    bench = bench_of(cells, only=["place=there"])

    assert [(cell.matrix, cell.coordinates.get("place")) for cell in bench.cells] == [("many", "there"), ("one", None)]


def test_an_error_in_a_value_is_told_at_its_line_of_the_bench_config(tmp_path: Path, plugins) -> None:
    (tmp_path / "b.yaml").write_text(
        "sources: {robot: {plugin: toy_wheels}}\n"
        "bench:\n"
        "  cells:\n"
        "    localizers:\n"
        "      good: {plugin: toy}\n"
        "      bad:\n"
        "        plugin: toy\n"
        "        scael: 1.0\n"
    )

    with pytest.raises(ConfigError, match=r"b.yaml line 8: localizers.bad.scael: unknown key \(did you mean 'scale'"):
        load_bench(tmp_path / "b.yaml", plugins=plugins)


@pytest.mark.parametrize(
    ("section", "message"),
    [
        ({"cells": {"localizers": ["toy"], "sedes": 3}}, "did you mean 'seeds'"),
        ({"cells": {"localizers": ["toy"], "seeds": 0}}, "must be at least 1"),
        ({"cells": {"localizers": ["toy"], "seeds": [1, 1]}}, "different numbers"),
        ({"cells": {"localizers": ["tyo"]}}, "did you mean 'toy'"),
        ({"cells": {"localizers": {"a": 3}}}, "must be a mapping, not 3"),
        ({"cells": {}}, "no localizers"),
    ],
)
def test_wrong_sections_are_refused(bench_of, section, message) -> None:
    with pytest.raises(ConfigError, match=message):
        bench_of(**section)


def test_a_config_without_a_bench_is_refused_with_an_example(plugins) -> None:
    with pytest.raises(ConfigError, match="this is no bench: add a section 'bench:'"):
        load_bench({"sources": {}}, plugins=plugins)


def test_a_value_that_needs_what_is_not_there_is_skipped(bench_of, tmp_path: Path) -> None:
    away = {"plugin": "toy_wheels", "recording": str(tmp_path / "r.txt"), "needs": str(tmp_path / "r.txt")}
    unset = {"plugin": "toy_wheels", "recording": "${NOT_SET_AT_ALL}/r", "needs": ["${NOT_SET_AT_ALL}"]}

    bench = bench_of({"sources": {"away": away, "unset": unset}, "localizers": ["toy"]}, run={"sources": {}})

    assert "is not there" in bench.cells[0].missing
    assert "NOT_SET_AT_ALL is not set" in bench.cells[1].missing


def test_a_value_may_have_limits_of_its_own(bench_of) -> None:
    cells = {"localizers": {"a": "toy", "b": {"plugin": "toy", "scale": 1.1, "limits": {"timeout_s": 7.0}}}}

    a, b = bench_of(cells, limits={"timeout_s": 60.0, "memory_mb": 4000.0}).cells

    assert (a.request["limits"]["timeout_s"], b.request["limits"]["timeout_s"]) == (60.0, 7.0)
    assert b.request["limits"]["memory_mb"] == 4000.0
    assert "limits" not in b.request["document"]["localizers"]["b"]


def test_teaching_is_the_same_config_with_what_is_different_laid_over_it(bench_of) -> None:
    cells = {
        "localizers": ["toy_fixer"],
        "perturbations": {"gaps": {"dropped": 0.5}},
        "teach": {"sources": {"robot": {"n": 60}}},
    }

    (cell,) = bench_of(cells).cells

    assert cell.request["document"]["mode"] == "replay"
    assert cell.request["teach"]["mode"] == "teach"
    assert cell.request["teach"]["sources"]["robot"]["n"] == 60
    assert cell.request["teach"]["sources"]["robot"]["perturb"] is None
    assert cell.request["document"]["sources"]["robot"]["n"] == 40


def test_every_installed_localizer_appears_and_named_ones_are_not_doubled(bench_of) -> None:
    cells = {"localizers": {"mine": {"plugin": "toy", "scale": 1.1}}, "installed": {"gives": ["motion"]}}

    names = [cell.coordinates["localizer"] for cell in bench_of(cells, limits={"threads": 1}).cells]

    assert names[0] == "mine"
    assert {"odometry", "ground_vo", "toy_fixer"} <= set(names)
    assert "toy" not in names
    assert "omni_surf" not in names  # gives fixes alone


class TestAddress:
    """What makes a cell another one."""

    def ids(self, bench_of, cells=None, **options) -> list[str]:
        return [cell.id for cell in bench_of(cells or {"localizers": ["toy"]}, **options).cells]

    def test_it_depends_on_config_seed_protocol_and_threads(self, bench_of) -> None:
        same = self.ids(bench_of)
        others = [
            self.ids(bench_of, {"localizers": {"toy": {"plugin": "toy", "scale": 1.1}}}),
            self.ids(bench_of, {"localizers": ["toy"], "seeds": [1]}),
            self.ids(bench_of, judging={"align": "origin"}),
            self.ids(bench_of, judging={"trajectory": "localizer"}),
            self.ids(bench_of, limits={"threads": 2}),
            self.ids(bench_of, run={"control_hz": 20}),
        ]

        assert self.ids(bench_of) == same
        assert len({same[0], *(ids[0] for ids in others)}) == 7

    def test_it_does_not_depend_on_where_it_stands_or_how_long_it_may_take(self, bench_of) -> None:
        cells = {"localizers": ["odometry", "toy"], "seeds": [0, 5]}

        assert self.ids(bench_of)[0] in self.ids(bench_of, cells)
        assert self.ids(bench_of, limits={"timeout_s": 5.0}) == self.ids(bench_of)

    def test_recordings_count_by_content_and_not_by_place(self, bench_of, tmp_path: Path) -> None:
        def ids(path: Path) -> list[str]:
            source = {"plugin": "toy_wheels", "recording": str(path)}
            return self.ids(bench_of, run={"sources": {"robot": source}})

        (tmp_path / "a.txt").write_text("1.0")
        shutil.copy(tmp_path / "a.txt", tmp_path / "b.txt")
        (tmp_path / "c.txt").write_text("2.0")

        assert ids(tmp_path / "a.txt") == ids(tmp_path / "b.txt")
        assert ids(tmp_path / "a.txt") != ids(tmp_path / "c.txt")

    def test_it_depends_on_the_code_of_the_parts(self, tmp_path: Path) -> None:
        from trailmark.isolation.fingerprint import source_digest

        package = tmp_path / "some_package"
        package.mkdir()
        (package / "__init__.py").write_text("x = 1\n")
        import sys

        sys.path.insert(0, str(tmp_path))
        try:
            first = source_digest("some_package")
            (package / "__init__.py").write_text("x = 2\n")
            source_digest.cache_clear()
            assert source_digest("some_package") != first
        finally:
            sys.path.remove(str(tmp_path))

    def test_twins_are_run_once_and_told(self, bench_of) -> None:
        bench = bench_of({"localizers": ["toy"], "pipelines": {"a": {}, "b": {"seed": 0}}})

        assert labels(bench) == ["toy, a, seed 0"]
        assert any("'toy, b, seed 0' is the same run as 'toy, a, seed 0'" in notice for notice in bench.notices)


class TestOverlay:
    def test_mappings_are_joined_and_all_else_replaced(self) -> None:
        assert overlaid({"a": {"x": 1, "y": [1]}, "b": 2}, {"a": {"y": [3]}}) == {"a": {"x": 1, "y": [3]}, "b": 2}

    def test_another_plugin_takes_nothing_over(self) -> None:
        base = {"estimator": {"plugin": "kalman", "gate": 3.0}}

        assert overlaid(base, {"estimator": "dead_reckoning"}) == {"estimator": {"plugin": "dead_reckoning"}}
        assert overlaid(base, {"estimator": {"gate": 2.0}}) == {"estimator": {"plugin": "kalman", "gate": 2.0}}


def test_places_are_laid_over_the_sources_and_belong_to_one_condition(bench_of) -> None:
    from trailmark_bench.naming import Namer

    places = {"near": {}, "far": {"sources": {"robot": {"n": 50}}}}
    bench = bench_of({"localizers": ["toy"], "places": places, "seeds": 2})

    assert [cell.label for cell in bench.cells] == [f"{p}, toy, seed {s}" for p in ("near", "far") for s in (0, 1)]
    assert [cell.request["document"]["sources"]["robot"]["n"] for cell in bench.cells] == [40, 40, 50, 50]
    assert {Namer(bench.cells).condition(cell) for cell in bench.cells} == {"all"}
