"""The web server: connections and their limits, hosts, cookies, and the end of the service."""
