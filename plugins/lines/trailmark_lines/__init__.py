"""A robot of any language as a source: JSON lines in, commands as JSON lines out."""
