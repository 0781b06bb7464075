from __future__ import annotations

import re
import subprocess
import sys
from importlib.resources import files

import pytest
from pydantic import ValidationError
from ruamel.yaml import YAML

from trailmark.config import sensor_roles
from trailmark_divs.config import DivsConfig


def test_the_papers_sizes_are_the_defaults():
    config = DivsConfig(camera="front")

    assert (config.window, config.columns, config.correlation_window) == (25, 50, 5)
    assert (config.spacing_m, config.region, config.threshold) == (0.015, (0.0, 0.5), "p90")


def test_pictures_of_colour_and_depth_cameras_are_subscribed_to():
    assert sensor_roles(DivsConfig)["camera"].kinds == ("image", "rgbd")


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"region": (0.5, 0.5)}, "not 0.5 to 0.5"),
        ({"region": (0.2, 1.1)}, "not 0.2 to 1.1"),
        ({"columns": 10, "correlation_window": 12}, r"correlation_window \(12\) is wider than columns \(10\)"),
        ({"columns": 12, "max_shift_columns": 10}, "at most 7 of 12 columns"),
        ({"window": 1}, "greater than or equal to 2"),
        ({"windw": 25}, "Extra inputs"),
    ],
)
def test_a_wrong_value_is_refused_and_named(settings, message):
    with pytest.raises(ValidationError, match=message):
        DivsConfig(camera="front", **settings)


def test_config_and_plugin_import_nothing_heavy():
    heavy = "{'cv2', 'numba', 'scipy', 'sklearn', 'matplotlib'}"
    code = f"import sys, trailmark_divs.plugin, trailmark_divs.config; sys.exit(bool({heavy} & set(sys.modules)))"

    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_the_starter_config_names_what_there_is():
    text = (files("trailmark_divs") / "starters" / "divs.yaml").read_text(encoding="utf-8")
    document = YAML(typ="safe").load(text)

    streams = dict(document["localizers"]["streams"])
    assert streams.pop("plugin") == "divs"
    assert DivsConfig(**streams).camera == "front"
    for key in re.findall(r"^    # (\w+):", text, flags=re.MULTILINE):
        assert key in DivsConfig.model_fields
