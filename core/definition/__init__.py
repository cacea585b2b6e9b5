"""The method in plain NumPy: exact, without shortcuts, and slow.  Each kernel is tested against it.

A radiance field on a tetrahedral mesh: tables of features belong to the vertices of nested
subdivisions of the tets, and two small networks turn features into density and color.  The features
of a point follow from its barycentric coordinates in its tet and from the corners' positions at
rest.  So when a solver of springs and volumes deforms the mesh, the image is deformed with it.

Read the modules in this order, from top to bottom:

1.  lattice       the coarse tets, and an integer address for each vertex
2.  subdivision   a point's way from its tet down to smaller and smaller ones
3.  encoding      features of a point
4.  networks      features to density and color; the field as a whole
5.  deformation   how a pose changes a tet: F, Q and s
6.  image         the pixels of a field in a pose, in four lines
7.  loss          the function that training minimizes
8.  solver        a substep: how vertices move
9.  contact       and how parts of the surface keep out of each other

All functions take arrays and compute in float64.  The modules import NumPy alone, but for __main__,
which has a loader that checks files, and a writer of images:

    python -m deformrf.core.definition model.npz -o picture.png --drag top:0.1,0,0
"""
