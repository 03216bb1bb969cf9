"""Whether the trunk enters a solid or itself, and the gaps that a plan has to keep."""
