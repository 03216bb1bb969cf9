"""Why the rod can be believed: `python -m trust.validate` writes docs/validation.md."""
