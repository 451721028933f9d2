"""Reading and checking finite element meshes."""
