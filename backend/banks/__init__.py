"""Controller banks: built from identifications, and the tuning settings that choose among their gains."""
