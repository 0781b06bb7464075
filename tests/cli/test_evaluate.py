"""``trailmark evaluate``: what it refuses, and what it warns of."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from trailmark.cli import main
from trailmark.geometry import Pose2, Trajectory, write_tum

HEAD = (
    "arrived_s,source,kind,since_s,stamp_s,x,y,theta,info_xx,info_xy,info_xt,info_yy,info_yt,info_tt,status,nis,dof,"
    "reason"
)


def way(turn_rad: float = 2.0) -> Trajectory:
    """Return 30 s of a bend."""
    return Trajectory.from_poses((0.1 * i, Pose2(0.05 * i, 0.01 * i, turn_rad * math.sin(i / 100))) for i in range(300))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A truth, the same with a gap, and fixes 1 cm beside it that state 1 cm."""
    monkeypatch.chdir(tmp_path)
    truth = way()
    write_tum("truth.tum", truth)
    with_gap = [line for line in Path("truth.tum").read_text().splitlines() if not 10.0 < float(line.split()[0]) < 20.0]
    Path("gap.tum").write_text("\n".join(with_gap) + "\n")
    write_fixes(Path("fixes.csv"), truth, 0.01)
    return tmp_path


def write_fixes(path: Path, truth: Trajectory, sigma: float, off_m: float = 0.01) -> None:
    information = f"{sigma**-2},0,0,{sigma**-2},0,{sigma**-2}"
    rows = []
    for i, (t, pose) in enumerate(truth):
        numbers = f"{pose.x + off_m * (-1) ** i},{pose.y + off_m},{pose.theta + off_m}"
        rows.append(f"{t:.6f},gps,fix,,{t:.6f},{numbers},{information},accepted,,,")
    path.write_text("\n".join([HEAD, *rows]) + "\n")


def call(*words: str) -> int:
    with pytest.raises(SystemExit) as left:
        main(["evaluate", *words])
    return int(left.value.code or 0)


def test_noise_in_a_gap_of_the_truth_is_not_measured_and_that_is_told(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call("--noise", "gap.tum", "fixes.csv") == 0

    printed = capsys.readouterr()
    assert "# 201 fixes: rms 0.01, 0.01 m, 0.573 deg" in printed.out
    assert printed.err == "fixes.csv: 99 of 300 estimates are left out: no true pose is near them (--max-difference)\n"


def test_the_largest_difference_goes_with_noise(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    late = Trajectory.from_poses((t + 0.05, pose) for t, pose in way())
    write_fixes(Path("late.csv"), late, 0.01)

    assert call("--noise", "truth.tum", "late.csv", "--max-difference", "0.02") == 2
    assert "0 of 300 estimates" in capsys.readouterr().err
    assert call("--noise", "truth.tum", "late.csv", "--max-difference", "0.06") == 0


@pytest.mark.parametrize(
    ("sigma", "off_m", "said"),
    [
        (1e-4, 0.01, "WARNING: a.csv: gps: its errors are "),
        (0.01, 1e-5, "WARNING: a.csv: gps: its errors are only "),
    ],
)
def test_errors_that_have_nothing_to_do_with_what_is_stated_are_warned_of(
    folder: Path, capsys: pytest.CaptureFixture[str], sigma: float, off_m: float, said: str
) -> None:
    write_fixes(Path("a.csv"), way(), sigma, off_m)

    assert call("--noise", "truth.tum", "a.csv") == 0

    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(said)
    assert "is the truth " in line


def test_usual_noise_is_no_reason_to_warn(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call("--noise", "truth.tum", "fixes.csv", "--json") == 0
    assert not capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--noise", "truth.tum", "fixes.csv", "--align", "se2"), "--align does not go with --noise"),
        (("--relations", "a.relations", "truth.tum", "--align", "none"), "--align does not go with --relations"),
    ],
)
def test_options_without_effect_are_refused(
    folder: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], said: str
) -> None:
    Path("a.relations").write_text("0.0 1.0 0.5 0.1 0 0 0 0\n")

    assert call(*words) == 2
    assert said in capsys.readouterr().err


def test_a_comment_that_holds_other_ends_of_lines_is_a_comment(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    straight = Trajectory.from_poses((0.1 * i, Pose2(0.05 * i)) for i in range(50))
    write_tum("straight.tum", straight)
    rows = Path("straight.tum").read_text()
    Path("odd.tum").write_text(f"# made by\x85 somebody\u2028 else\x0c\n{rows}", encoding="utf-8")

    with pytest.raises(SystemExit) as end:
        main(["evaluate", "straight.tum", "odd.tum"])

    assert not end.value.code, capsys.readouterr().err


def test_noise_needs_two_true_poses(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_tum("one.tum", Trajectory.from_poses([(0.0, Pose2())]))

    assert call("--noise", "one.tum", "fixes.csv") == 2
    assert "one.tum: the ground truth has fewer than two poses" in capsys.readouterr().err


def w_first(path: str, turn_rad: float) -> str:
    write_tum(path, way(turn_rad))
    rows = [line.split() for line in Path(path).read_text().splitlines()]
    Path(path).write_text("\n".join(" ".join([*row[:4], row[7], *row[4:7]]) for row in rows) + "\n")
    return path


@pytest.mark.parametrize("turn_rad", [0.2, 3.0])
def test_quaternions_with_w_first_are_warned_of(
    folder: Path, capsys: pytest.CaptureFixture[str], turn_rad: float
) -> None:
    assert call("truth.tum", w_first("a.tum", turn_rad)) == 0
    assert "WARNING: a.tum: read as qx qy qz qw" in capsys.readouterr().err
    assert call(w_first("a.tum", turn_rad), "truth.tum") == 0
    assert "WARNING: a.tum: read as qx qy qz qw" in capsys.readouterr().err


@pytest.mark.parametrize(
    "quaternion",
    [
        lambda a: (0.0, 0.0, 0.0, 1.0),
        lambda a: (1.0, 0.0, 0.0, 0.0),  # mounted head down, and driven straight
        lambda a: (0.0, math.sin(a), 0.0, math.cos(a)),  # of a camera: about the vertical, which is y
        lambda a: (math.cos(a), math.sin(a), 0.0, 0.0),  # head down
        lambda a: (math.sin(0.3 * a), 0.0, 0.0, math.cos(0.3 * a)),  # rolling, and never over
    ],
)
def test_other_ways_are_not_taken_for_that(folder: Path, capsys: pytest.CaptureFixture[str], quaternion) -> None:
    rows = []
    for i in range(200):
        numbers = " ".join(f"{value:.9f}" for value in quaternion(0.01 * i))
        rows.append(f"{0.1 * i:.1f} {0.05 * i} {0.01 * i} 0 {numbers}")
    Path("a.tum").write_text("\n".join(rows) + "\n")

    assert call("truth.tum", "a.tum") == 0
    assert not capsys.readouterr().err


def write_two(path: Path) -> None:
    """Write what two localizers said of one way, the second 20 mm to the left of the first."""
    lines = [HEAD]
    for i in range(40):
        for source, aside_m in (("laser", 0.0), ("tags", 0.02)):
            lines.append(
                f"{0.1 * i},{source},fix,,{0.1 * i},{0.05 * i},{aside_m},0,10000,0,0,10000,0,10000,accepted,,,"
            )
    path.write_text("\n".join(lines) + "\n")


def test_localizers_are_compared_without_a_truth(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_two(Path("two.csv"))

    with pytest.raises(SystemExit) as left:
        main(["evaluate", "--between", "two.csv", "--json"])

    assert not left.value.code
    (document,) = json.loads(capsys.readouterr().out)["tables"]
    (found,) = document["differences"]
    assert (found["one"], found["other"], found["kind"], found["n"]) == ("laser", "tags", "fix", 40)
    assert found["rms_m"] == [pytest.approx(0.0), pytest.approx(0.02)]
    assert found["nees_per_dof"] == pytest.approx(0.02**2 / (2 * 1e-4) / 3)


def test_the_table_names_both_and_the_unit(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_two(Path("two.csv"))

    with pytest.raises(SystemExit):
        main(["evaluate", "--between", "--against", "laser", "two.csv"])

    said = capsys.readouterr().out
    assert "tags - laser" in said
    assert "[mm]" in said


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--against", "laser", "two.csv"), "--against belongs to --between"),
        (("--between", "--noise", "two.csv"), "--between goes with --against and --json alone"),
        (("--between", "--align", "none", "two.csv"), "--between goes with --against and --json alone"),
        (("--between", "--against", "radar", "two.csv"), "no localizer 'radar' said anything; there are laser, tags"),
        (("--between", "fixes.csv"), "no two localizers say the same kind of thing"),
    ],
)
def test_what_does_not_fit_between_is_refused(
    folder: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], said: str
) -> None:
    write_two(Path("two.csv"))

    with pytest.raises(SystemExit) as left:
        main(["evaluate", *words])

    assert left.value.code == 2
    assert said in capsys.readouterr().err
