"""Metrics of runs, and the evaluation that stores them. Pure, but for the evaluation."""
