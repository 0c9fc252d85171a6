"""Meshes seen by a nonlocal model: sizes, slits, layers along boundaries, and what sees what."""
