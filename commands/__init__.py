"""The entry points, one file each.

No door: before `entry` has told Python to forget the current folder, nothing else is imported.
"""
