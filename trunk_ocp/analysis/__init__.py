"""Analysis of motions and plans."""
