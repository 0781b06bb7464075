"""``trailmark init``: what it refuses."""

from __future__ import annotations

from pathlib import Path

import pytest

from trailmark.cli import main


@pytest.mark.parametrize("words", [["--out", "mine.yaml"], ["--force"]])
def test_options_without_a_name_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], words: list[str]
) -> None:
    monkeypatch.chdir(tmp_path)

    with pytest.raises(SystemExit) as left:
        main(["init", *words])

    assert left.value.code == 2
    assert f"{' '.join(words)} needs the NAME of a starter config: " in capsys.readouterr().err
    assert not any(tmp_path.iterdir())
