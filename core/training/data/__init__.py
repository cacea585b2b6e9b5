"""Photographs and cameras, in the layouts that other programs write."""
