"""Plans of experiments, their metrics, and the runner shared by browser and command line."""
