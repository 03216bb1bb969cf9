"""Long checks of what the package promises, each with counts of what was tried and what held."""
