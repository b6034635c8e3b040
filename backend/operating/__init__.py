"""What is done with the actuator now: commands, state, tuning in force, runs under way. Knows no HTTP."""
