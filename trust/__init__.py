"""Checks that go further than the tests: many random inputs, with counts to show for it."""
