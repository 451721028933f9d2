"""A bracket of spring steel, 2 mm thick, in mm: writes bracket.msh (needs gmsh)."""

import gmsh

gmsh.initialize()
solid = gmsh.model.occ
base = solid.addBox(0, 0, 0, 80, 30, 2)
upright = solid.addBox(78, 0, 0, 2, 30, 120)
hole = solid.addCylinder(25, 15, 0, 0, 0, 2, 5)
solid.cut(solid.fuse([(3, base)], [(3, upright)])[0], [(3, hole)])
solid.synchronize()

for name, dimension, box in [
    ("STEEL", 3, (-1, -1, -1, 81, 31, 121)),
    ("CLAMP", 2, (-1, -1, -1, 1, 31, 3)),  # the face x = 0
    ("TIP", 2, (77, -1, 119, 81, 31, 121)),  # the face z = 120 mm
]:
    found = gmsh.model.getEntitiesInBoundingBox(*box, dim=dimension)
    gmsh.model.addPhysicalGroup(dimension, [tag for _, tag in found], name=name)

gmsh.option.setNumber("Mesh.MeshSizeMax", 6)
gmsh.option.setNumber("Mesh.ElementOrder", 2)
gmsh.model.mesh.generate(3)
gmsh.write("bracket.msh")
