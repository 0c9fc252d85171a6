"""A file of any mesher made a sound simplicial mesh."""
