"""Use cases of the service: the actuator and its state, jobs, stored runs, upkeep. Knows no HTTP."""
