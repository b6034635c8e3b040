"""From identified models and one parameter λ to gains, margins and previews: pure and offline."""
