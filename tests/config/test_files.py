from __future__ import annotations

from pathlib import Path

import pytest
from pydantic import ValidationError

from trailmark.config import ConfigPath, ExistingFile, ExistingPath, PluginConfig, read_calibration
from trailmark.config.document import read_document
from trailmark.config.files import resolve_path
from trailmark.errors import ConfigError
from trailmark.frames import GroundPlane, Pinhole


class Files(PluginConfig):
    there: ExistingPath | None = None
    file: ExistingFile | None = None
    out: ConfigPath | None = None


def test_relative_paths_start_at_the_folder_of_the_config(tmp_path):
    (tmp_path / "a.tum").touch()

    files = Files.model_validate({"there": "a.tum", "file": "a.tum", "out": "b/c"}, context={"base_dir": tmp_path})

    assert files.there == tmp_path / "a.tum"
    assert files.file == str(tmp_path / "a.tum")
    assert files.out == tmp_path / "b" / "c"


def test_without_a_config_they_start_at_the_working_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.tum").touch()

    assert Files(there="a.tum").there == tmp_path / "a.tum"


def test_absolute_paths_and_the_home_folder_stay_what_they_are(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    context = {"base_dir": tmp_path / "elsewhere"}

    assert Files.model_validate({"there": str(tmp_path)}, context=context).there == tmp_path
    assert Files.model_validate({"out": "~/x"}, context=context).out == tmp_path / "x"


@pytest.mark.parametrize("name", ["missing", "x" * 5000, "nul\0byte", "~no_such_user_at_all/x"])
def test_a_path_that_cannot_exist_is_a_validation_error(tmp_path, name):
    with pytest.raises(ValidationError, match="no such file or folder"):
        Files.model_validate({"there": name}, context={"base_dir": tmp_path})


def test_a_calibration_may_be_numbers_or_a_file_beside_its_arrays(tmp_path):
    import numpy as np

    np.save(tmp_path / "flat.npy", np.ones((2, 2), dtype=np.float32))
    (tmp_path / "floor.yaml").write_text("{metres_per_pixel: 4e-4, flat_field: flat.npy}")
    (tmp_path / "front.toml").write_text("fx = 500\nfy = 500\ncx = 320\ncy = 240\n")
    (tmp_path / "front.json").write_text('{"fx": 500, "fy": 500, "cx": 320, "cy": 240}')

    floor = read_calibration("floor.yaml", tmp_path)

    assert isinstance(floor, GroundPlane)
    assert floor.flat_field is not None
    assert read_calibration("front.toml", tmp_path) == read_calibration("front.json", tmp_path)
    assert isinstance(read_calibration({"fx": 5, "fy": 5, "cx": 3, "cy": 2}), Pinhole)


def test_a_calibration_file_that_is_no_calibration_is_named(tmp_path):
    (tmp_path / "bad.yaml").write_text("{fx: 1, fy: 2}")

    with pytest.raises(ConfigError, match=r"^bad.yaml: calibration lacks cx, cy"):
        read_calibration("bad.yaml", tmp_path)


def test_a_variable_in_a_path_is_expanded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RECORDINGS", str(tmp_path))

    assert resolve_path("${RECORDINGS}/a.bag") == tmp_path / "a.bag"


def test_a_variable_that_is_not_set_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("RECORDINGS", raising=False)

    with pytest.raises(ValueError, match="environment variable RECORDINGS is not set"):
        resolve_path("${RECORDINGS}/a.bag")


def test_a_device_is_no_recording():
    with pytest.raises(ValidationError, match="is neither a file nor a folder: /dev/zero"):
        Files.model_validate({"there": "/dev/zero"})


def test_a_device_is_no_config():
    with pytest.raises(ConfigError, match="/dev/zero is a device or a pipe, not a config file"):
        read_document("/dev/zero")


def test_an_anchor_may_be_used_again(tmp_path: Path) -> None:
    config = tmp_path / "run.yaml"
    config.write_text("rate: &n 1\nseed: &n 2\nsize: *n\n")

    assert read_document(config).data == {"rate": 1, "seed": 2, "size": 2}


@pytest.mark.parametrize("version", ["1.1", "1.3", "2.0", "x"])
def test_a_config_of_another_yaml_is_refused_with_its_line(tmp_path: Path, version: str) -> None:
    config = tmp_path / "run.yaml"
    config.write_text(f"# a comment\n\n%YAML {version}\n---\nis_on: no\n")

    with pytest.raises(ConfigError, match=rf"run.yaml line 3: this says it is YAML {version}: configs are YAML 1.2"):
        read_document(config)


def test_a_config_may_say_that_it_is_yaml_1_2(tmp_path: Path) -> None:
    config = tmp_path / "run.yaml"
    config.write_text("%YAML 1.2\n---\nname: no\nabout: |\n  %YAML 1.1\n")

    assert read_document(config).data == {"name": "no", "about": "%YAML 1.1\n"}


@pytest.mark.parametrize(
    ("text", "tag"), [("!!set {a}", "set"), ("!!omap [a: 1]", "omap"), ("!!binary aGk=", "binary")]
)
def test_what_is_no_plain_data_is_refused_with_its_line(tmp_path: Path, text: str, tag: str) -> None:
    config = tmp_path / "run.yaml"
    config.write_text(f"first: 1\nsecond: {text}\n")

    with pytest.raises(ConfigError, match=rf"run.yaml line 2: YAML: a config holds plain data, no !!{tag}"):
        read_document(config)
