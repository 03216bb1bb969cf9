"""Trials and validation cases that look for errors in this package, and their reports."""
