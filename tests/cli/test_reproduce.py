"""The seed of ``trailmark reproduce``: a number, or one that is drawn and said, so that it can be given again."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import click
import pytest

from trailmark.cli.reproduce import SeedType

PLUGIN = """
from trailmark import hookimpl
from trailmark.experiments import Row

def toy(options):
    return [Row("toy", "seed", "", float(options.seed))]

@hookimpl
def trailmark_register(registry):
    registry.experiment("toy", ":toy", summary="Says its seed")
"""


def seed_of_toy(trailmark: Any, tmp_path: Path, seed: str) -> tuple[int, str]:
    """Return with which seed an experiment was run, and what was said of it."""
    plugin = tmp_path / f"{tmp_path.name}.py"  # a process takes a name for one file
    plugin.write_text(PLUGIN, encoding="utf-8")
    arguments = ["--plugin", plugin, "reproduce", "toy", "--out", tmp_path / "out", "--json"]
    done = trailmark(*arguments, "--seed", seed, "--quick")
    assert done.returncode == 0, done.stderr
    return int(json.loads(done.stdout)[0]["ours"]), done.stderr


def test_a_drawn_seed_is_said_and_repeats_the_run(trailmark: Any, tmp_path: Path) -> None:
    drawn, said = seed_of_toy(trailmark, tmp_path, "random")

    named = re.search(r"--seed (\d+) repeats this", said)
    assert named is not None
    assert int(named[1]) == drawn
    assert f"--seed {drawn} " in (tmp_path / "out" / "toy" / "results.md").read_text(encoding="utf-8")
    assert seed_of_toy(trailmark, tmp_path, named[1])[0] == drawn


@pytest.mark.parametrize("cut", ["", "{", '"other"'])
def test_what_an_interrupted_run_left_half_is_done_anew(trailmark: Any, tmp_path: Path, cut: str) -> None:
    noted = tmp_path / "out" / "toy" / ".calls" / "request.json"
    noted.parent.mkdir(parents=True)
    noted.write_text(cut, encoding="utf-8")

    assert seed_of_toy(trailmark, tmp_path, "3")[0] == 3


def test_seeds_are_drawn_anew_each_time() -> None:
    kind = SeedType()

    assert len({kind.convert("random", None, None) for _ in range(5)}) > 1


@pytest.mark.parametrize("wrong", ["-1", "any", "1.5"])
def test_what_is_no_seed_is_refused(wrong: str) -> None:
    with pytest.raises(click.BadParameter):
        SeedType().convert(wrong, None, None)
