"""Single pictures of a taught sequence compared with the present one: the peers of visual streams."""
