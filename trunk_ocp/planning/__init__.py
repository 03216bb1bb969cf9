"""Plans: made, checked, kept, and made again."""
