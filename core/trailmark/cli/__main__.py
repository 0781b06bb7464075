"""``python -m trailmark.cli``, the same as ``trailmark``."""

from trailmark.cli import main

main()
