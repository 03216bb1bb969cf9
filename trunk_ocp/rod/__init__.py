"""How it bends: the equations of the rod and their solutions (section 2.2)."""
