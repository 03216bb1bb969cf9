"""The model for other programs: its map from activations to shape, and the derivatives of it."""
