"""Tools for the tests of plugins: synthetic runs with exact ground truth."""
