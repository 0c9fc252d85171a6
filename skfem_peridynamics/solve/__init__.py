"""Time: the stable step, the central difference method and what is prescribed."""
