"""Attacks on the real service: crowds at its door, kills, halts, a wrong clock, a full disk, a lost folder."""
