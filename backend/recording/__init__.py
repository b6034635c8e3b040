"""From the ring to stored one-second chunks, and back."""
