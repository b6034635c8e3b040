"""A robot at the real page, and what the page shows compared with what the service says after each thing it does."""
