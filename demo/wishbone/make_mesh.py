"""Mesh of wishbone.step: ten-node tetrahedra, in mm, in wishbone.msh (needs gmsh)."""

from pathlib import Path

import gmsh

HERE = Path(__file__).parent

gmsh.initialize()
gmsh.option.setNumber("General.Verbosity", 2)
gmsh.merge(str(HERE / "wishbone.step"))
for name, value in (("SizeMax", 16), ("SizeMin", 6), ("SizeFromCurvature", 11)):
    gmsh.option.setNumber(f"Mesh.Mesh{name}", value)
gmsh.option.setNumber("Mesh.ElementOrder", 2)
gmsh.option.setNumber("Mesh.HighOrderOptimize", 2)
gmsh.model.mesh.generate(3)
gmsh.option.setNumber("Mesh.Binary", 1)
gmsh.write(str(HERE / "wishbone.msh"))
gmsh.finalize()
