"""A run of a scene, its check and its error estimate."""
