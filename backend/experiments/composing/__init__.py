"""From an experiment that is data to a program: its text, its expressions, its parts laid out, what it reaches."""
