"""Bring the loop up, play a program, keep its run: live, headless, or dry beside the service."""
