"""The 1 kHz loop process and the service's side of it: the only real-time code of the project."""
