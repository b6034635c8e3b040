"""The 3D view: the only package that imports viser."""
