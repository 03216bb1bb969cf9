"""Motions for other programs: glTF for 3D viewers, VTK for ParaView, .sto for OpenSim.

The writers need only NumPy and SciPy: for such simple formats a writer is shorter than an adapter
to a library.
"""

from __future__ import annotations

from .glb import write_glb
from .opensim import write_sto
from .paraview import write_vtk

__all__ = ["write_glb", "write_sto", "write_vtk"]
