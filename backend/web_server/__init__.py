"""The web server: sockets, who gets a place, time limits, and what no request gets past."""
