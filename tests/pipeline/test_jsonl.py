"""Lines of JSON, one for everything that happens."""

from __future__ import annotations

import io
import json
import math
import sys

import pytest

from trailmark.commands import Stop, Velocity
from trailmark.errors import ConfigError
from trailmark.estimates import Applied, Belief, EstimateRecord, Fix, Lost, PathOffset, information_from_sigmas
from trailmark.geometry import Pose2
from trailmark.interfaces import RunEnd, Session
from trailmark.pipeline.outputs.jsonl import JsonlSink
from trailmark.pipeline.outputs.jsonl_config import JsonlConfig

GOOD = information_from_sigmas(0.1, 0.1, 0.1)


def started(**config) -> JsonlSink:
    sink = JsonlSink(JsonlConfig(**config))
    sink.start(Session())
    return sink


def lines(text: str) -> list[dict]:
    return [json.loads(line) for line in text.splitlines()]


def test_commands_carry_their_own_fields(capsys) -> None:
    sink = started()

    sink.on_command(1.5, Velocity(0.5, yaw_radps=0.1))
    sink.on_command(1.6, Stop("arrived", done=True))

    assert lines(capsys.readouterr().out) == [
        {"type": "command", "stamp_s": 1.5, "kind": "Velocity", "forward_mps": 0.5, "left_mps": 0.0, "yaw_radps": 0.1},
        {"type": "command", "stamp_s": 1.6, "kind": "Stop", "reason": "arrived", "done": True},
    ]


def test_every_kind_of_estimate_has_its_numbers(capsys) -> None:
    sink = started(estimates=True)

    sink.on_estimate_record(EstimateRecord(0.0, "map", Fix(1.0, Pose2(1.0, 2.0, 0.5), GOOD), Applied("accepted")))
    sink.on_estimate_record(
        EstimateRecord(0.0, "divs", PathOffset(2.0, 3.0, 0.1, 0.2, GOOD), Applied("late", "too old"))
    )
    sink.on_estimate_record(EstimateRecord(0.0, "map", Lost(3.0, "dark"), Applied("unused", "lost: dark")))

    fix, offset, lost = lines(capsys.readouterr().out)
    assert fix["pose_map_base"] == [1.0, 2.0, 0.5]
    assert (offset["on_path"], offset["status"], offset["reason"]) == ([3.0, 0.1, 0.2], "late", "too old")
    assert lost["lost"] == "dark"


def test_a_belief_on_a_path_says_where(capsys) -> None:
    started().on_belief(Belief(1.0, Pose2(), on_path=PathOffset(1.0, 3.0, 0.1, 0.2, GOOD), fix_age_m=0.5))

    (belief,) = lines(capsys.readouterr().out)
    assert belief["on_path"] == [3.0, 0.1, 0.2]
    assert belief["fix_age_m"] == 0.5
    assert belief["motion_age_s"] is None


def test_what_is_not_wanted_is_not_written(capsys) -> None:
    sink = started(beliefs=False, commands=False)

    sink.on_belief(Belief(1.0))
    sink.on_command(1.0, Stop("x"))
    sink.on_estimate_record(EstimateRecord(0.0, "map", Lost(3.0, "dark"), Applied("unused")))
    sink.on_end(RunEnd("stopped", "no motion"))

    assert lines(capsys.readouterr().out) == [{"type": "end", "status": "stopped", "reason": "no motion"}]


def test_standard_error_is_a_choice(capsys) -> None:
    started(to="stderr").on_belief(Belief(1.0, motion_age_s=math.inf))

    captured = capsys.readouterr()
    assert captured.out == ""
    assert len(lines(captured.err)) == 1


def test_nobody_listening_ends_nothing(monkeypatch) -> None:
    class Closed(io.StringIO):
        n_written = 0

        def write(self, text):
            Closed.n_written += 1
            raise BrokenPipeError

    monkeypatch.setattr(sys, "stdout", Closed())
    sink = started()

    sink.on_belief(Belief(1.0))
    sink.on_belief(Belief(2.0))

    assert Closed.n_written == 1


def test_a_file_that_cannot_be_written_is_a_config_error(tmp_path) -> None:
    with pytest.raises(ConfigError, match=r"jsonl cannot write to .*: Is a directory"):
        started(to=tmp_path)
