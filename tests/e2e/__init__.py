"""Tests of the page in a real browser. A package, so that all modules share the browser and the service."""
