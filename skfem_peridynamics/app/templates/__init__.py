"""Scenes to begin with, as files."""
