"""What is done to find this package wrong: cases, files, faults, and counts of what held."""
