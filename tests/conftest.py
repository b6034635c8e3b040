"""What all tests share: property tests that are the same on each run, whatever else the machine is doing."""

from hypothesis import settings

settings.register_profile("sinew", deadline=None, derandomize=True, database=None)
settings.load_profile("sinew")
