"""The shapes of everything the HTTP interface takes and gives, by subject."""
