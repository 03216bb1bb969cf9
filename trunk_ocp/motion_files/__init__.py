"""Motions for other programs: glTF for viewers, VTK for ParaView, .sto for OpenSim.

Nothing but NumPy and SciPy is needed to write them: each format is plain enough that a writer of
our own is shorter than the glue to a library.
"""

from __future__ import annotations

from .glb import write_glb
from .opensim import write_sto
from .paraview import write_vtk

__all__ = ["write_glb", "write_sto", "write_vtk"]
