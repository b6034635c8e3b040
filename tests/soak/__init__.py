"""Long runs and repeated kills on the real service: ``python -m tests.soak``."""
