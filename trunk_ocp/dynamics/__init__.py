"""The trunk with inertia: what quasi-static plans leave out, and motions that have it."""
