"""What foresight is worth: everything computed again, and docs/foresight.md from the data."""
