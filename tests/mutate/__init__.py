"""Mutation tests: the code is changed in one place at a time, and its tests have to fail."""
