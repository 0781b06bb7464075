"""Whatever is written, a config loads or is refused with a `ConfigError`: never anything else."""

from __future__ import annotations

import contextlib
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from trailmark.config import load_run_config
from trailmark.config.document import TextError
from trailmark.config.toml_text import read_toml
from trailmark.config.yaml_text import read_yaml
from trailmark.errors import ConfigError

WORDS = [
    *("sources", "sensors", "localizers", "estimator", "path_store", "controller", "sinks", "plugins", "mode", "seed"),
    *("floor", "plugin", "klt", "ground_vo", "image_folder", "kalman", "use", "camera", "path", "rate_hz", "gains"),
    *("calibration", "mounting", "rename", "start", "stop_when", "enable", "block", "require", "~nobody/x", "x" * 300),
    *("metres_per_pixel", "fx", "flat_field", "flat.npy", "async", "latency_ms", "0", "\0"),
]
SCALARS = st.none() | st.booleans() | st.integers() | st.floats() | st.sampled_from(WORDS) | st.text(max_size=3)
KEYS = st.sampled_from(WORDS) | st.integers(0, 2) | st.none() | st.booleans()
TREES: st.SearchStrategy[Any] = st.recursive(
    SCALARS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner, max_size=4),
    max_leaves=12,
)
PARTS = st.dictionaries(st.sampled_from(WORDS), TREES, max_size=3).map(lambda part: {"plugin": "klt"} | part)
CONFIGS = st.dictionaries(
    st.sampled_from(WORDS[:10]) | KEYS, TREES | st.dictionaries(KEYS, PARTS, max_size=2), max_size=4
)
OVERRIDES = st.lists(
    st.builds(
        lambda keys, value: f"{'.'.join(keys)}={value}",
        st.lists(st.sampled_from(WORDS), min_size=1, max_size=4),
        st.sampled_from(["1", "[1]", "{plugin: klt}", "null", "klt", "{", "a: b: c"]),
    )
    | st.text(max_size=8),
    max_size=2,
)
TOKENS = [
    *list("abc:- \n,[]{}#&*!|>'\"%@`01.eE+-_~?<="),
    *(
        "!!int ",
        "!!bool ",
        "!!binary ",
        "!!omap ",
        "%YAML 1.1\n---\n",
        "<<: ",
        "&a ",
        "*a",
        "0o",
        ".nan",
        "\n  ",
        "---\n",
    ),
]
TEXTS = st.lists(st.sampled_from(TOKENS), max_size=25).map("".join)


@settings(max_examples=200, deadline=None)
@given(config=CONFIGS, overrides=OVERRIDES)
def test_any_data_loads_or_is_refused(config, overrides, plugins):
    with contextlib.suppress(ConfigError):
        load_run_config(config, plugins=plugins, overrides=overrides).yaml()


@settings(max_examples=200, deadline=None)
@given(text=TEXTS)
def test_any_text_is_read_or_refused(text):
    for read in (read_yaml, read_toml):
        with contextlib.suppress(TextError):
            _, line_of = read(text)
            line_of(("a", 0, "b"))


def test_text_that_is_nested_too_deeply_is_refused():
    for read, text in ((read_yaml, "[" * 5000), (read_toml, "a = " + "[" * 5000)):
        with contextlib.suppress(TextError):
            read(text)
            raise AssertionError("it was read")
