"""The web server: sockets, who gets a place, time limits, cookies, and what no request gets past."""
