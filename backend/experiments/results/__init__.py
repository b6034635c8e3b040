"""From what was recorded to figures, criteria and estimates, and the document that keeps them."""
