"""Write the small files of this folder by the libraries of the programs that users have.

Run in an environment with gmsh, meshio, netCDF4, mapdl-archive, pyvista and pyNastran, as `python make.py`; the tests
read the files only. One bar of 10-node tetrahedra and one of 20-node bricks, 1 × 0.1 × 0.1 m along x, with the sets
ROOT (x = 0), TIP (x = 1) and BAR (all).
"""

from pathlib import Path

import gmsh
import mapdl_archive
import meshio
import netCDF4
import numpy as np
import pyvista
from pyNastran.bdf.bdf import BDF

HERE = Path(__file__).parent
E, NU, RHO = 2.0e11, 0.3, 7850.0
# Where Nastran and Exodus have the mid-side nodes of a brick.
BRICK = [*range(12), *range(16, 20), *range(12, 16)]


def bar(kind):
    """Mesh the bar in gmsh."""
    gmsh.model.add(kind)
    gmsh.model.occ.addBox(0, 0, 0, 1, 0.1, 0.1)
    gmsh.model.occ.synchronize()
    ends = {0.0: "ROOT", 1.0: "TIP"}
    for _, face in gmsh.model.getEntities(2):
        x = round(gmsh.model.occ.getCenterOfMass(2, face)[0], 6)
        if x in ends:
            gmsh.model.addPhysicalGroup(2, [face], name=ends[x])
    gmsh.model.addPhysicalGroup(3, [1], name="BAR")
    if kind == "bricks":
        for _, edge in gmsh.model.getEntities(1):
            along = abs(gmsh.model.occ.getMass(1, edge) - 1.0) < 1e-9
            gmsh.model.mesh.setTransfiniteCurve(edge, 7 if along else 3)
        for _, face in gmsh.model.getEntities(2):
            gmsh.model.mesh.setTransfiniteSurface(face)
            gmsh.model.mesh.setRecombine(2, face)
        gmsh.model.mesh.setTransfiniteVolume(1)
    gmsh.option.setNumber("Mesh.MeshSizeMax", 0.2)
    gmsh.option.setNumber("Mesh.SecondOrderIncomplete", 1)
    gmsh.model.mesh.generate(3)
    gmsh.model.mesh.setOrder(2)
    for name, version, binary in (("msh41", 4.1, 0), ("msh22", 2.2, 0), ("binary", 4.1, 1)):
        gmsh.option.setNumber("Mesh.MshFileVersion", version)
        gmsh.option.setNumber("Mesh.Binary", binary)
        gmsh.write(str(HERE / f"gmsh_{kind}_{name}.msh"))
    gmsh.option.setNumber("Mesh.Binary", 0)
    gmsh.option.setNumber("Mesh.SaveGroupsOfNodes", 1)
    gmsh.option.setNumber("Mesh.BdfFieldFormat", 2)
    for suffix in ("inp", "med", "bdf", "unv"):
        gmsh.write(str(HERE / f"gmsh_{kind}.{suffix}"))
    return meshio.read(HERE / f"gmsh_{kind}_msh41.msh")


def deck(points, kind, rows, path):
    """The same mesh as a deck, which the others are compared with."""
    name = {"tetra10": "C3D10", "hexahedron20": "C3D20R"}[kind]
    lines = ["*NODE", *(f"{k}, {x!r}, {y!r}, {z!r}" for k, (x, y, z) in enumerate(points.tolist(), 1))]
    lines.append(f"*ELEMENT, TYPE={name}, ELSET=BAR")
    for k, row in enumerate((rows + 1).tolist(), 1):
        texts = [str(k), *map(str, row)]
        lines += [
            ", ".join(texts[:11]) + ("," if len(texts) > 11 else ""),
            *([", ".join(texts[11:])] if texts[11:] else []),
        ]
    for name, x in (("ROOT", 0.0), ("TIP", 1.0)):
        lines += [f"*NSET, NSET={name}", *(f"{k}," for k in ends(points, x) + 1)]
    lines += ["*MATERIAL, NAME=STEEL", "*ELASTIC", f"{E}, {NU}", "*DENSITY", f"{RHO}"]
    lines += ["*SOLID SECTION, ELSET=BAR, MATERIAL=STEEL"]
    path.write_text("\n".join(lines) + "\n")


def ends(points, x):
    return np.flatnonzero(np.isclose(points[:, 0], x))


def nastran(points, kind, rows, path):
    """Bulk data with a local coordinate system, an included file, sets, RBE2 and RBE3."""
    order = BRICK if kind == "hexahedron20" else range(10)
    model = BDF(debug=None)
    model.sol = 103
    model.add_cord2r(5, [1.0, 2.0, 3.0], [1.0, 2.0, 4.0], [1.0, 3.0, 3.0])
    for k, point in enumerate(points, 1):
        # Every other node in coordinate system 5: its x along global y, its y against global x.
        x, y, z = point - [1.0, 2.0, 3.0] if k % 2 else point
        model.add_grid(k, [y, -x, z] if k % 2 else [x, y, z], cp=5 if k % 2 else 0)
    # A mark that only shows something.
    model.add_plotel(9100, [1, 2])
    add = model.add_chexa if kind == "hexahedron20" else model.add_ctetra
    place = np.argsort(list(order)) if kind == "tetra10" else order
    for k, row in enumerate(rows + 1, 1):
        card = np.empty(len(row), dtype=int)
        card[list(place)] = row
        add(k, 7, card.tolist())
    model.add_psolid(7, 3)
    # In units in which PARAM,WTMASS makes masses of weights.
    model.add_mat1(3, E, None, NU, rho=RHO * 1000.0)
    model.add_param("WTMASS", [0.001])
    root, tip = (ends(points, x) + 1 for x in (0.0, 1.0))
    model.add_grid(9001, [1.2, 0.05, 0.05])
    model.add_grid(9002, [-0.2, 0.05, 0.05])
    model.add_rbe3(9001, 9001, "123456", [1.0], ["123"], [tip.tolist()])
    model.add_rbe2(9002, 9002, "123456", root.tolist())
    model.add_set1(11, root.tolist())
    model.write_bdf(str(path), size=16, is_double=True, enddata=True, write_header=False, interspersed=False)
    bulk = path.read_text().split("CEND\n", 1)[1]
    part = path.with_name(path.stem + "_nodes.inc")
    lines = bulk.splitlines(keepends=True)
    start = next(k for k, line in enumerate(lines) if line.startswith("GRID*"))
    stop = max(k for k, line in enumerate(lines) if line.startswith("GRID*")) + 2
    part.write_text("".join(lines[start:stop]))
    numbers = tip.tolist()
    listed = ",\n  ".join(", ".join(map(str, numbers[k : k + 8])) for k in range(0, len(numbers), 8))
    head = f"SOL 103\nCEND\nSET 4 = {listed}\nSPC = 1\nBEGIN BULK\n"
    path.write_text(head + "".join(lines[:start]) + f"INCLUDE '{part.name}'\n" + "".join(lines[stop:]))


def ansys(points, kind, rows, path):
    """Archive with components and a material."""
    cell = {"tetra10": pyvista.CellType.QUADRATIC_TETRA, "hexahedron20": pyvista.CellType.QUADRATIC_HEXAHEDRON}[kind]
    grid = pyvista.UnstructuredGrid({cell: rows}, points)
    for name, x in (("ROOT", 0.0), ("TIP", 1.0)):
        mask = np.zeros(len(points), dtype=bool)
        mask[ends(points, x)] = True
        grid.point_data[name] = mask
    grid.cell_data["ansys_material_type"] = np.ones(len(rows), dtype=int)
    grid.cell_data["BAR"] = np.ones(len(rows), dtype=bool)
    mapdl_archive.save_as_archive(path, grid)
    text = path.read_text()
    made = "".join(
        f"MPTEMP,R5.0, 1, 1,  0.00000000    ,\nMPDATA,R5.0, 1,{label:4},       1, 1, {value:.9E},\n"
        for label, value in (("EX", E), ("NUXY", NU), ("DENS", RHO))
    )
    path.write_text(text.rstrip() + "\n" + made)


def exodus(points, kind, rows, path, file_format):
    """Blocks, a node set and a side set, as Cubit and Sierra number them."""
    order = BRICK if kind == "hexahedron20" else list(range(10))
    placed = np.empty_like(rows)
    placed[:, order] = rows
    with netCDF4.Dataset(path, "w", format=file_format) as file:
        root = ends(points, 0.0) + 1
        sides = faces(points, kind, rows, 1.0)
        for name, size in (
            ("len_name", 33), ("num_dim", 3), ("num_nodes", len(points)), ("num_elem", len(rows)), ("num_el_blk", 1),
            ("num_el_in_blk1", len(rows)), ("num_nod_per_el1", rows.shape[1]), ("num_node_sets", 1),
            ("num_nod_ns1", len(root)), ("num_side_sets", 1), ("num_side_ss1", len(sides)),
        ):  # fmt: skip
            file.createDimension(name, size)
        file.setncatts({"api_version": 8.0, "version": 8.0, "floating_point_word_size": 8, "file_size": 1})
        for axis, values in zip("xyz", points.T, strict=True):
            file.createVariable(f"coord{axis}", "f8", ("num_nodes",))[:] = values
        connect = file.createVariable("connect1", "i4", ("num_el_in_blk1", "num_nod_per_el1"))
        connect[:] = placed + 1
        connect.elem_type = "HEX20" if kind == "hexahedron20" else "TETRA10"
        for key, name, count in (
            ("eb", "BAR", "num_el_blk"),
            ("ns", "ROOT", "num_node_sets"),
            ("ss", "TIP", "num_side_sets"),
        ):
            file.createVariable(f"{key}_names", "S1", (count, "len_name"))[:] = np.array(
                [list(name.ljust(33, "\0"))], "S1"
            )
        file.createVariable("node_ns1", "i4", ("num_nod_ns1",))[:] = root
        file.createVariable("elem_ss1", "i4", ("num_side_ss1",))[:] = sides[:, 0] + 1
        file.createVariable("side_ss1", "i4", ("num_side_ss1",))[:] = sides[:, 1] + 1


def faces(points, kind, rows, x):
    """Elements and their sides, as Exodus numbers them, that lie in a plane across the bar."""
    table = {
        "tetra10": ((0, 1, 3), (1, 2, 3), (0, 3, 2), (0, 2, 1)),
        "hexahedron20": ((0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (0, 4, 7, 3), (0, 3, 2, 1), (4, 5, 6, 7)),
    }[kind]
    return np.array(
        [
            (k, s)
            for k, row in enumerate(rows)
            for s, face in enumerate(table)
            if np.allclose(points[row[list(face)], 0], x)
        ]
    )


def main():
    """Write every file."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    for kind, cells in (("tets", "tetra10"), ("bricks", "hexahedron20")):
        found = bar(kind)
        points, rows = found.points, np.vstack([block.data for block in found.cells if block.type == cells])
        deck(points, cells, rows, HERE / f"deck_{kind}.inp")
        nastran(points, cells, rows, HERE / f"nastran_{kind}.bdf")
        ansys(points, cells, rows, HERE / f"ansys_{kind}.cdb")
        exodus(points, cells, rows, HERE / f"exodus_{kind}.e", "NETCDF4" if kind == "tets" else "NETCDF3_64BIT_OFFSET")
        marks = {name: np.isclose(points[:, 0], x).astype(np.int32) for name, x in (("ROOT", 0.0), ("TIP", 1.0))}
        plain = meshio.Mesh(points, [(cells, rows)], marks, {"BAR": [np.ones(len(rows), dtype=np.int32)]})
        for suffix in ("vtk", "vtu", "xdmf"):
            options = {"data_format": "XML"} if suffix == "xdmf" else {}
            meshio.write(HERE / f"meshio_{kind}.{suffix}", plain, **options)
        meshio.write(HERE / f"meshio_{kind}.bdf", plain)
    gmsh.finalize()


if __name__ == "__main__":
    main()
