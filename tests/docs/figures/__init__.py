"""Computations of the figures in the documents; ``make figures`` updates the documents."""
