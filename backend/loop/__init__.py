"""The 1 kHz control process: the only real-time code of the project."""
