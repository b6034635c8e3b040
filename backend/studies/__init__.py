"""Many simulated runs of one experiment: which they are, one of them, who computes them, what they come to."""
