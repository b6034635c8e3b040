"""Experiments and identifications, the same for browser and command line: plans, forecasts, playing, results, banks."""
