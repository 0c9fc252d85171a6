"""Sums that come out the same for any number of threads: BLAS splits its own by how many it has."""

from __future__ import annotations
