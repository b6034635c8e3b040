"""Routes by subject: each validates, calls one function, returns a schema."""
