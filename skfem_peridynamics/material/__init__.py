"""What a bond is made of: influence functions, potentials and their calibration."""
