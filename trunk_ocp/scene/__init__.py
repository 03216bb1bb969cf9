"""What there is to draw, decided once for figures, page and files."""
