"""Samples as files for other programs and installations: written in streams, read back, bundled with their lineage."""
