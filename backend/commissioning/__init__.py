"""Commissioning of a rig: wiring, load cells, directions, zero, homing, tension, safety module."""
