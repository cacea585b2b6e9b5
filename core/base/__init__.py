"""What everything stands on: device, threads, caches, native code, files, arguments.

No door: import its modules.
"""
