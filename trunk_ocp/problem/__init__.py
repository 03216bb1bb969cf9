"""What is asked: problem files, motions, targets (section 5, appendix B)."""
