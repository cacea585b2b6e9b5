"""The interactive viewer: the only room with windows and OpenGL.  command.main is the program."""
