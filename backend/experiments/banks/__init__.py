"""Controller banks and the tuning that is applied to them: built, compared, carried as files, chosen, kept."""
