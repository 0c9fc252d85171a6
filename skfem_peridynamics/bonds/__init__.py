"""Bonds: the sample points, ends and weights that integrate the nonlocal double integral."""
