"""Whether the tests would notice: what computes is changed in one place at a time, and its tests have to fail."""
