"""The method in plain NumPy: exact, without shortcuts, and slow.  Every kernel is held to it.

A radiance field on a tetrahedral mesh: tables of features belong to the vertices of nested
subdivisions of the tets, and two small networks turn features into density and color.  A point
finds its features from its barycentric coordinates in its tet and the tet's addresses at rest.  So
the mesh may be deformed, here by a solver of springs and volumes, and the image follows.

Read the modules in this order, from top to bottom:

1.  lattice       the coarse tets, and an integer address for each vertex
2.  subdivision   a point's way from its tet down to smaller and smaller ones
3.  encoding      features of a point
4.  networks      features to density and color; the field as a whole
5.  deformation   what a pose does to a tet: F, Q and s
6.  image         the pixels of a field in a pose, in four lines
7.  loss          what training makes small
8.  solver        a substep: how vertices move
9.  contact       and how parts of the surface keep out of each other

All functions take arrays and compute in float64.  The modules import NumPy alone, but for __main__,
which has a loader that checks files, and a writer of images:

    python -m deformrf.core.definition model.npz -o picture.png --drag top:0.1,0,0
"""
