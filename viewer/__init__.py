"""The interactive viewer: the only room with windows and OpenGL."""
