"""Command line: `solve-motion` and `trunk-ocp`."""
