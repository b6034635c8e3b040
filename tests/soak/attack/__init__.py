"""Attacks on the real service: load, kills, suspended processes, a wrong clock, a full disk, a lost folder."""
