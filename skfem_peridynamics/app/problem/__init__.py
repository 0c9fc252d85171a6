"""From a scene to the objects of the library."""
