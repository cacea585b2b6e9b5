"""Modules that all rooms use: device, threads, caches, native code, files, arguments.

This room has no door: import its modules.
"""
