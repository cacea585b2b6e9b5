"""The panels: each a function of (scene, actions, status) that draws one section.

They read the scene and the status, and change things through the scene's methods, its
settings and `actions`, the same methods that the keys call.
"""
