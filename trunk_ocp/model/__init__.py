"""The trunk: anatomy, muscles, head and loads (sections 2.1, 3 and 4 of the paper)."""
