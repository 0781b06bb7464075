"""Print the lower bounds of pyproject.toml as constraints for pip."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

project = tomllib.loads(Path("pyproject.toml").read_text(encoding="utf-8"))["project"]
extras = [line for name in ("bags", "dask", "foxglove") for line in project["optional-dependencies"][name]]
for requirement in [*project["dependencies"], *extras]:
    name, bound = re.fullmatch(r"([\w.-]+)>=([\d.]+).*", requirement).groups()
    print(f"{name}=={bound}.*")
