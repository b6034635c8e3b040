"""A robot operates the real page; after each action the page is compared with the service."""
