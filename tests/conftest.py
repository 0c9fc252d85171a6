"""Seeds are fixed: a failure is one that everybody can repeat."""

from hypothesis import settings

settings.register_profile("fixed", derandomize=True, database=None)
settings.load_profile("fixed")
