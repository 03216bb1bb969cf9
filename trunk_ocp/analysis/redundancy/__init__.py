"""Which part of the muscles' work a motion determines, and which part is a choice.

Activation enters the shape of a segment through four numbers, made by 8 or 10 muscles. The freedom
that remains is computed exactly: ranges by linear programs, the best choices by convex programs.
"""
