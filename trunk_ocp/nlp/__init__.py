"""The transcription: a window of time steps as one nonlinear program for Ipopt."""
