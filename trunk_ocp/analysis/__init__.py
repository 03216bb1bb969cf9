"""Questions about motions and plans."""
