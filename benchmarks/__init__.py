"""Benchmarks and comparisons with other codes: `make bench`."""
