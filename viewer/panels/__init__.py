"""Panels: one function each, (scene, actions) -> None."""
