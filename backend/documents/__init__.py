"""What is stored as JSON, as dataclasses: each kind of document has one place that reads it and writes it."""
