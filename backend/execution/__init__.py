"""Experiments from order to stored result, on the live loop or a simulator."""
