"""The loaded rod: its equations and their solutions (section 2.2 of the paper)."""
