"""Configs that are made to hang or to swell are refused within a second, with the line."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from trailmark.config.document import read_document
from trailmark.config.toml_text import read_toml
from trailmark.config.yaml_text import TextError, read_yaml
from trailmark.errors import ConfigError


def merge_bomb(levels: int) -> str:
    """Each level merges the one before nine times."""
    lines = ["a: &a {x: 1}"]
    for level in range(levels):
        name, before = chr(98 + level), chr(97 + level)
        lines.append(f"{name}: &{name} {{<<: [{','.join([f'*{before}'] * 9)}]}}")
    return "\n".join(lines)


@pytest.mark.parametrize("levels", [5, 9, 20])
def test_a_bomb_of_merge_keys_is_refused_at_once(levels: int) -> None:
    began_s = time.thread_time()

    with pytest.raises(TextError, match=r"the merge keys \(<<\) make more than 10000 keys"):
        read_yaml(merge_bomb(levels))

    assert time.thread_time() - began_s < 1.0


def test_merge_keys_of_ordinary_size_are_merged() -> None:
    data, _ = read_yaml("base: &base {plugin: klt, camera: floor}\nown: {<<: *base, camera: front}\n")

    assert data["own"] == {"plugin": "klt", "camera": "front"}


def test_an_integer_of_5000_digits_is_refused_in_toml_and_yaml() -> None:
    with pytest.raises(TextError, match="thousands of digits"):
        read_toml(f"seed = {'9' * 5000}")
    with pytest.raises(TextError, match="is no int"):
        read_yaml(f"seed: {'9' * 5000}")


@pytest.mark.parametrize("suffix", ["yaml", "toml"])
def test_ten_megabytes_are_refused_unread(tmp_path: Path, suffix: str) -> None:
    config = tmp_path / f"large.{suffix}"
    config.write_text("# filler\n" * 1_200_000)
    began_s = time.thread_time()

    with pytest.raises(ConfigError, match=r"has 10\.8 MB: no config is larger than 1 MB"):
        read_document(config)

    assert time.thread_time() - began_s < 1.0


def test_a_pipe_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    pipe = tmp_path / "config.yaml"
    os.mkfifo(pipe)

    with pytest.raises(ConfigError, match="is a device or a pipe"):
        read_document(pipe)
