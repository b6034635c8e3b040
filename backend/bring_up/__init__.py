"""Bringing a rig up: small steps at low voltage over the loop that runs, one engine for browser and command line."""
