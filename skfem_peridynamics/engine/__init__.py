"""Energy, force and products of a bond list: by sparse products, or by compiled loops."""
