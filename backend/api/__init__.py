"""HTTP and websocket: a route validates, calls one function, returns a schema."""
